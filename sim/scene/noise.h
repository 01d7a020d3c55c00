// SPDX-License-Identifier: Apache-2.0
// Smooth 3D value noise: scalar double precision for rock shapes, and single precision for sixteen points at a time for
// albedo.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace fringeslam::sim {

// Evaluates lattice noise in [-1, 1], interpolated with a quintic fade; one unit of `p` is one lattice cell.
double value_noise(const Eigen::Vector3d& p, uint32_t seed);

// Evaluates the normalised sum, in [-1, 1], of `octaves` noises, each at half the scale and weight of the previous one.
double fractal_noise(const Eigen::Vector3d& p, int octaves, uint32_t seed);

inline constexpr int kNoiseLanes = 16;

// Coordinates in lattice cells, valid within a few thousand cells of the origin.
struct alignas(64) NoisePoints {
  float x[kNoiseLanes], y[kNoiseLanes], z[kNoiseLanes];
};
struct alignas(64) NoiseValues {
  float value[kNoiseLanes];
};

NoiseValues value_noise(const NoisePoints& points, uint32_t seed);
NoiseValues fractal_noise(const NoisePoints& points, int octaves, uint32_t seed);

}  // namespace fringeslam::sim
