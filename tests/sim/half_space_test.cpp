// SPDX-License-Identifier: Apache-2.0
// The prediction for fringes on translucent surfaces, against tables, limits and a random walk.
#include "bench/accuracy/half_space.h"

#include <gtest/gtest.h>

#include <numbers>

#include "sim/random.h"

namespace fringeslam::bench {
namespace {

using std::numbers::pi;

Eigen::Vector3d direction(double tilt_deg, double azimuth_deg = 0) {
  const double t = tilt_deg * pi / 180, a = azimuth_deg * pi / 180;
  return {std::sin(t) * std::cos(a), std::sin(t) * std::sin(a), std::cos(t)};
}

// Chandrasekhar (1960), table XI: H(1) without absorption.
TEST(HalfSpace, HAgreesWithChandrasekharsTable) {
  EXPECT_NEAR(HalfSpace(1).h(1, 0).real(), 2.9078, 1e-4);
  EXPECT_NEAR(HalfSpace(1).h(0.5, 0).real(), 2.0128, 1e-4);
  EXPECT_NEAR(HalfSpace(0).h(1, 0).real(), 1, 1e-12);
}

// Two expressions for the same albedo: the closed form, and the sum of the light over all directions.
TEST(HalfSpace, TheLightOfAllDirectionsIsTheAlbedo) {
  for (const double scattering : {0.5, 0.9, 0.99}) {
    const HalfSpace space(scattering);
    for (const double tilt : {0.0, 50.0}) {
      double sum = 0;
      constexpr int kSteps = 400;
      for (int i = 0; i < kSteps; ++i) {
        const double cosine = (i + 0.5) / kSteps;
        const Eigen::Vector3d to_viewer = direction(std::acos(cosine) * 180 / pi);
        sum += 2 * cosine / kSteps * space.reflected(direction(tilt), to_viewer, {0, 0}).real();
      }
      EXPECT_NEAR(sum, space.albedo(std::cos(tilt * pi / 180)), 2e-4) << scattering << ", " << tilt;
    }
  }
}

TEST(HalfSpace, OfAnAlbedoHasThisAlbedo) {
  for (const double albedo : {0.1, 0.5, 0.8, 0.95}) EXPECT_NEAR(HalfSpace::of_albedo(albedo).albedo(1), albedo, 1e-9);
}

// Very fine fringes survive in light scattered once, w / 4 / ((p + q) l_n v_n).
TEST(HalfSpace, FineFringesAreScatteredOnce) {
  const HalfSpace space(0.9);
  const Eigen::Vector3d light = direction(0), viewer = direction(0);
  EXPECT_NEAR(std::abs(space.reflected(light, viewer, {1e5, 0})), 0.9 / 8, 1e-4);
  EXPECT_GT(std::abs(space.reflected(light, viewer, {1, 0})), 0.2);
}

TEST(HalfSpace, ExchangingLightAndViewerReversesTheShift) {
  const HalfSpace space(0.97);
  const Eigen::Vector3d a = direction(40, 20), b = direction(15, -70);
  const std::complex<double> there = space.reflected(a, b, {0.7, 0.2}), back = space.reflected(b, a, {0.7, 0.2});
  EXPECT_NEAR(std::abs(there - std::conj(back)), 0, 1e-12);
  EXPECT_GT(std::abs(std::arg(there)), 0.05);
}

// Photons walk through the half-space; each scattering sends light to the viewer. The pattern is the real part of
// e^(i k x) at the point of entry, and its phase that relative to the point seen.
TEST(HalfSpace, AgreesWithARandomWalk) {
  const double scattering = 0.95;
  const Eigen::Vector3d to_light = direction(45), to_viewer = direction(20, 180);
  const Eigen::Vector2d wave(0.6, 0);
  constexpr int kWalks = 40000;
  std::complex<double> sum = 0;
  double squares[2] = {0, 0};
  for (int walk = 0; walk < kWalks; ++walk) {
    sim::Philox random(7, sim::Stream::paths, static_cast<uint32_t>(walk));
    Eigen::Vector3d position = Eigen::Vector3d::Zero(), step = -to_light;
    std::complex<double> seen = 0;
    for (double weight = 1; weight > 1e-4;) {
      position += -std::log(random.uniform()) * step;
      if (position.z() >= 0) break;
      weight *= scattering;
      // Light leaves towards the viewer at `exit`; the radiance per irradiance l_n is weight e^(-depth / v_n) / (4 pi v_n).
      const Eigen::Vector3d exit = position - position.z() / to_viewer.z() * to_viewer;
      seen += weight / (4 * to_viewer.z()) * std::exp(position.z() / to_viewer.z()) *
              std::polar(1.0, -wave.dot(exit.head<2>()));
      const double z = random.uniform(-1, 1), phi = random.uniform(0, 2 * pi), r = std::sqrt(1 - z * z);
      step = {r * std::cos(phi), r * std::sin(phi), z};
    }
    sum += seen;
    squares[0] += seen.real() * seen.real();
    squares[1] += seen.imag() * seen.imag();
  }
  const std::complex<double> mean = sum / static_cast<double>(kWalks);
  const std::complex<double> exact = HalfSpace(scattering).reflected(to_light, to_viewer, wave);
  const double sigma[2] = {std::sqrt((squares[0] / kWalks - mean.real() * mean.real()) / kWalks),
                           std::sqrt((squares[1] / kWalks - mean.imag() * mean.imag()) / kWalks)};
  EXPECT_NEAR(mean.real(), exact.real(), 4 * sigma[0]);
  EXPECT_NEAR(mean.imag(), exact.imag(), 4 * sigma[1]);
  EXPECT_GT(std::abs(exact.imag()), 20 * sigma[1]);
}

}  // namespace
}  // namespace fringeslam::bench
