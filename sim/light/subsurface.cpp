// SPDX-License-Identifier: Apache-2.0
#include "sim/light/subsurface.h"

#include <cmath>

namespace fringeslam::sim {

double profile_length_m(double albedo, double mean_free_path_m) {
  const double off = std::abs(albedo - 0.8);
  return mean_free_path_m / (1.85 - albedo + 7 * off * off * off);
}

double far_shift_m(double albedo, double mean_free_path_m) { return 0.7 * (1 + albedo) * mean_free_path_m; }

double refractive_index(double reflectance) {
  const double root = std::sqrt(reflectance);
  return (1 + root) / (1 - root);
}

ProfileSample sample_profile(double length_m, double u) {
  constexpr double kNear = 0.25;
  if (u < kNear) return {-length_m * std::log1p(-u / kNear), false};
  return {-3 * length_m * std::log1p(-(u - kNear) / (1 - kNear)), true};
}

}  // namespace fringeslam::sim
