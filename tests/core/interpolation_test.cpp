// SPDX-License-Identifier: Apache-2.0
// Interpolation between pixels, and the change of brightness between poses.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "core/base/constants.h"
#include "core/base/cubic_spline.h"
#include "core/types/irradiance.h"

namespace fringeslam {
namespace {

// Coefficients of the spline through samples that continue far enough on both sides.
std::vector<double> coefficients_of(const std::vector<double>& samples) {
  const auto filter = spline_prefilter();
  std::vector<double> coefficients(samples.size(), 0.0);
  for (size_t i = kSplineRadius; i + kSplineRadius < samples.size(); ++i) {
    for (size_t k = 0; k < filter.size(); ++k)
      coefficients[i] += static_cast<double>(filter[k]) * samples[i + k - kSplineRadius];
  }
  return coefficients;
}

double at(const std::vector<double>& coefficients, size_t left, double fraction) {
  const SplineWeights weights(static_cast<float>(fraction));
  double value = 0;
  for (size_t k = 0; k < 4; ++k) value += static_cast<double>(weights.weight[k]) * coefficients[left - 1 + k];
  return value;
}

TEST(CubicSpline, PassesThroughItsSamplesAndReproducesCubics) {
  std::vector<double> samples;
  const auto cubic = [](double x) { return 3 + 0.2 * x - 0.01 * x * x + 2e-4 * x * x * x; };
  for (int i = 0; i < 60; ++i) samples.push_back(cubic(i - 30));
  const std::vector<double> coefficients = coefficients_of(samples);
  for (const double fraction : {0.0, 0.1, 0.25, 0.5, 0.9})
    EXPECT_NEAR(at(coefficients, 30, fraction), cubic(fraction), 1e-3);
}

TEST(CubicSpline, KeepsPhaseAndAmplitudeOfFringes) {
  constexpr double kPeriod = 10;
  std::vector<double> cosine, sine;
  for (int i = 0; i < 80; ++i) {
    cosine.push_back(std::cos(kTwoPi * i / kPeriod));
    sine.push_back(std::sin(kTwoPi * i / kPeriod));
  }
  const std::vector<double> of_cosine = coefficients_of(cosine), of_sine = coefficients_of(sine);
  for (const double fraction : {0.1, 0.2, 0.3, 0.5, 0.8}) {
    const double c = at(of_cosine, 40, fraction), s = at(of_sine, 40, fraction);
    EXPECT_NEAR(std::remainder(std::atan2(s, c) - kTwoPi * (40 + fraction) / kPeriod, kTwoPi), 0, 2e-4);
    EXPECT_NEAR(std::hypot(c, s), 1, 1e-3);
  }
}

TEST(CubicSpline, NoiseIsThatOfTheCardinalSpline) {
  // Weights of the samples: the response to a unit impulse at each of them.
  for (const double fraction : {0.0, 0.1, 0.25, 0.4, 0.5, 0.75}) {
    double variance = 0;
    for (size_t impulse = 15; impulse < 65; ++impulse) {
      std::vector<double> samples(80, 0.0);
      samples[impulse] = 1;
      const double weight = at(coefficients_of(samples), 40, fraction);
      variance += weight * weight;
    }
    EXPECT_NEAR(static_cast<double>(spline_noise(static_cast<float>(fraction))), variance, 0.005);
  }
}

TEST(Irradiance, SlopesAreThoseOfTheBrightness) {
  RigModel rig;
  rig.camera_lens.vignetting = 4;
  rig.projector_lens.vignetting = 2.5;
  rig.projector_from_camera = {rotation_exp({0.02, 0.17, -0.01}), {-0.25, 0.01, 0.04}};
  const auto log_brightness = [&](const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
    const Eigen::Vector3d l = rig.projector_from_camera * point;
    return std::log(std::abs((rig.projector_from_camera.rotation * normal).dot(l))) - 3 * std::log(l.norm()) +
           (rig.projector_lens.vignetting - 3) * std::log(l.z() / l.norm()) +
           rig.camera_lens.vignetting * std::log(point.z() / point.norm());
  };
  const Eigen::Vector3d point(0.2, -0.15, 1.1), normal = Eigen::Vector3d(0.3, 0.1, -1).normalized();
  const auto slope = Irradiance<double>(rig).slope(point.data(), normal.data());
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
    EXPECT_NEAR(slope.by_shift[k],
                (log_brightness(point + step, normal) - log_brightness(point - step, normal)) / (2 * kStep), 1e-6);
    EXPECT_NEAR(
        slope.by_turn[k],
        (log_brightness(point, rotation_exp(step) * normal) - log_brightness(point, rotation_exp(-step) * normal)) /
            (2 * kStep),
        1e-6);
  }
}

}  // namespace
}  // namespace fringeslam
