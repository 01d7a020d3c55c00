// SPDX-License-Identifier: Apache-2.0
// Smooth value noise in space, for albedo and for the shape of rocks.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace fringeslam::sim {

// Cubic-interpolated lattice noise in [-1, 1]; one unit of `p` is one lattice cell.
double value_noise(const Eigen::Vector3d& p, uint32_t seed);

// Sum of `octaves` noises, each of half the size and half the weight of the one before, in [-1, 1].
double fractal_noise(const Eigen::Vector3d& p, int octaves, uint32_t seed);

}  // namespace fringeslam::sim
