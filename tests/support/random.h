// SPDX-License-Identifier: Apache-2.0
// Seeded random numbers for tests. Unlike the distributions of <random>, which differ between standard libraries, these
// are the same on all platforms.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

namespace fringeslam::support {

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}

  double uniform(double low, double high) {
    return low + (high - low) * ((static_cast<double>(engine_() >> 11) + 0.5) * 0x1p-53);
  }

  // Standard normal (Box-Muller).
  double normal() {
    const double radius = std::sqrt(-2 * std::log(uniform(0, 1)));
    return radius * std::cos(uniform(0, 2 * std::numbers::pi));
  }

  template <int Size>
  Eigen::Matrix<double, Size, 1> normals() {
    return Eigen::Matrix<double, Size, 1>::NullaryExpr([this](Eigen::Index) { return normal(); });
  }

  // Uniformly distributed on the unit sphere.
  Eigen::Vector3d direction() { return normals<3>().normalized(); }

  // Zero-mean normal with the given covariance.
  template <int Size>
  Eigen::Matrix<double, Size, 1> gaussian(const Eigen::Matrix<double, Size, Size>& covariance) {
    return covariance.llt().matrixL() * normals<Size>();
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace fringeslam::support
