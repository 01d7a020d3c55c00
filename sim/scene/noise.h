// SPDX-License-Identifier: Apache-2.0
// Smooth value noise in space: in double precision for the shape of rocks, sixteen points at once in single
// precision for albedo.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace fringeslam::sim {

// Cubic-interpolated lattice noise in [-1, 1]; one unit of `p` is one lattice cell.
double value_noise(const Eigen::Vector3d& p, uint32_t seed);

// Sum of `octaves` noises, each of half the size and half the weight of the one before, in [-1, 1].
double fractal_noise(const Eigen::Vector3d& p, int octaves, uint32_t seed);

inline constexpr int kNoiseLanes = 16;

// Within a few thousand cells of the origin.
struct alignas(64) NoisePoints {
  float x[kNoiseLanes], y[kNoiseLanes], z[kNoiseLanes];
};
struct alignas(64) NoiseValues {
  float value[kNoiseLanes];
};

NoiseValues value_noise(const NoisePoints& points, uint32_t seed);
NoiseValues fractal_noise(const NoisePoints& points, int octaves, uint32_t seed);

}  // namespace fringeslam::sim
