// SPDX-License-Identifier: Apache-2.0
#include "sim/light/air.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringeslam::sim {

double henyey_greenstein(double anisotropy, double cosine) {
  const double g = anisotropy, d = 1 + g * g - 2 * g * cosine;
  return (1 - g * g) / (4 * std::numbers::pi * d * std::sqrt(d));
}

AirSample equiangular(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double length_m,
                      const Eigen::Vector3d& light, double u) {
  const double foot = (light - origin).dot(direction);
  const double height = std::max(1e-6, (origin + foot * direction - light).norm());
  const double first = std::atan2(-foot, height), last = std::atan2(length_m - foot, height);
  const double offset = height * std::tan(first + u * (last - first));
  return {std::clamp(foot + offset, 0.0, length_m), height / ((last - first) * (height * height + offset * offset))};
}

}  // namespace fringeslam::sim
