// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/noise.h"

#include <cmath>

namespace fringeslam::sim {

namespace {

// Hashes a lattice point to [-1, 1].
double lattice(int x, int y, int z, uint32_t seed) {
  uint32_t h = seed * 0x9e3779b9u + static_cast<uint32_t>(x) * 0x85ebca6bu + static_cast<uint32_t>(y) * 0xc2b2ae35u +
               static_cast<uint32_t>(z) * 0x27d4eb2fu;
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h * (2.0 / 4294967295.0) - 1.0;
}

double smooth(double t) { return t * t * t * (t * (6 * t - 15) + 10); }

}  // namespace

double value_noise(const Eigen::Vector3d& p, uint32_t seed) {
  const Eigen::Vector3d floor = p.array().floor();
  const Eigen::Vector3i cell = floor.cast<int>();
  const double wx = smooth(p.x() - floor.x()), wy = smooth(p.y() - floor.y()), wz = smooth(p.z() - floor.z());
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
    sum += (i ? wx : 1 - wx) * (j ? wy : 1 - wy) * (k ? wz : 1 - wz) *
           lattice(cell.x() + i, cell.y() + j, cell.z() + k, seed);
  }
  return sum;
}

double fractal_noise(const Eigen::Vector3d& p, int octaves, uint32_t seed) {
  double sum = 0, weight = 1, total = 0;
  Eigen::Vector3d q = p;
  for (int octave = 0; octave < octaves; ++octave) {
    sum += weight * value_noise(q, seed + static_cast<uint32_t>(octave) * 101u);
    total += weight;
    weight *= 0.5;
    q *= 2;
  }
  return sum / total;
}

}  // namespace fringeslam::sim
