// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/half_space.h"

#include <cmath>

#include "core/base/constants.h"

namespace fringeslam::bench {

HalfSpace HalfSpace::of_albedo(double albedo) {
  double low = 0, high = 1;
  for (int i = 0; i < 50; ++i) {
    const double middle = 0.5 * (low + high);
    (HalfSpace(middle).albedo(1) < albedo ? low : high) = middle;
  }
  return HalfSpace(0.5 * (low + high));
}

std::complex<double> HalfSpace::h(std::complex<double> z, double wave_number) const {
  // Midpoint rule in a, t = tan^3(a): dense near t = 0, where the integrand has a logarithmic peak for small k and w
  // near 1.
  constexpr int kSteps = 2000;
  constexpr double kStep = 0.5 * kPi / kSteps;
  std::complex<double> sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double tangent = std::tan((i + 0.5) * kStep), t = tangent * tangent * tangent;
    const double slope = 3 * tangent * tangent * (1 + tangent * tangent);
    const double s = std::hypot(t, wave_number);
    const double lost = s < 1e-3 ? s * s / 3 : 1 - std::atan(s) / s;  // the series avoids cancellation
    sum -= slope * std::log((1 - scattering_) + scattering_ * lost) / (1.0 + z * z * t * t);
  }
  return std::exp(z / kPi * kStep * sum);
}

double HalfSpace::albedo(double cosine) const { return 1 - h(cosine, 0).real() * std::sqrt(1 - scattering_); }

std::complex<double> HalfSpace::reflected(const Eigen::Vector3d& to_light, const Eigen::Vector3d& to_viewer,
                                          const Eigen::Vector2d& wave) const {
  const std::complex<double> p(1 / to_light.z(), -wave.dot(to_light.head<2>()) / to_light.z());
  const std::complex<double> q(1 / to_viewer.z(), wave.dot(to_viewer.head<2>()) / to_viewer.z());
  return 0.25 * scattering_ * h(1.0 / p, wave.norm()) * h(1.0 / q, wave.norm()) /
         ((p + q) * to_light.z() * to_viewer.z());
}

}  // namespace fringeslam::bench
