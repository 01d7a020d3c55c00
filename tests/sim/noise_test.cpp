// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/noise.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "sim/random.h"
#include "sim/scene/scene.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

std::vector<Eigen::Vector3d> random_points(int count, double half_size) {
  Philox random(11, Stream::shape, 0);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double x = random.uniform(-half_size, half_size), y = random.uniform(-half_size, half_size);
    points.emplace_back(x, y, random.uniform(-half_size, half_size));
  }
  return points;
}

TEST(Noise, StaysWithinOneAndUsesTheRange) {
  double low = 0, high = 0, fractal_low = 0, fractal_high = 0;
  for (const Eigen::Vector3d& p : random_points(200000, 50)) {
    const double value = value_noise(p, 3), fractal = fractal_noise(p, 5, 3);
    low = std::min(low, value), high = std::max(high, value);
    fractal_low = std::min(fractal_low, fractal), fractal_high = std::max(fractal_high, fractal);
  }
  EXPECT_GE(low, -1);
  EXPECT_LE(high, 1);
  EXPECT_LT(low, -0.8);
  EXPECT_GT(high, 0.8);
  EXPECT_GE(fractal_low, -1);
  EXPECT_LE(fractal_high, 1);
  EXPECT_LT(fractal_low, -0.5);
  EXPECT_GT(fractal_high, 0.5);
}

TEST(Noise, HasNoPreferredSign) {
  double sum = 0;
  const auto points = random_points(200000, 1000);
  for (const Eigen::Vector3d& p : points) sum += value_noise(p, 5);
  // Each point has a standard deviation below 0.6, and 2000^3 cells make the points independent.
  EXPECT_LT(std::abs(sum / static_cast<double>(points.size())), 5 * 0.6 / std::sqrt(200000.0));
}

TEST(Noise, IsAFunctionOfPointAndSeed) {
  int different = 0;
  for (const Eigen::Vector3d& p : random_points(1000, 50)) {
    EXPECT_EQ(value_noise(p, 3), value_noise(p, 3));
    EXPECT_EQ(fractal_noise(p, 4, 3), fractal_noise(p, 4, 3));
    different += value_noise(p, 3) != value_noise(p, 4);
  }
  EXPECT_EQ(different, 1000);
}

TEST(Noise, IsContinuousAcrossCells) {
  constexpr double kStep = 1e-9;
  for (const int i : {-7, -1, 0, 1, 12}) {
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3d below(0.3, -2.6, 5.2), above = below;
      below[axis] = i - kStep;
      above[axis] = i + kStep;
      EXPECT_NEAR(value_noise(below, 3), value_noise(above, 3), 1e-7) << i << " along axis " << axis;
    }
  }
}

TEST(Noise, OneOctaveIsValueNoise) {
  for (const Eigen::Vector3d& p : random_points(100, 20)) EXPECT_EQ(fractal_noise(p, 1, 9), value_noise(p, 9));
}

// The packet version agrees with sixteen single evaluations.
TEST(Noise, LanesAgreeWithDoublePrecision) {
  const std::vector<Eigen::Vector3d> points = random_points(160, 50);
  for (size_t first = 0; first < points.size(); first += kNoiseLanes) {
    NoisePoints lanes;
    for (size_t i = 0; i < kNoiseLanes; ++i) {
      const Eigen::Vector3f p = points[first + i].cast<float>();
      lanes.x[i] = p.x(), lanes.y[i] = p.y(), lanes.z[i] = p.z();
    }
    const NoiseValues values = fractal_noise(lanes, 4, 23);
    for (size_t i = 0; i < kNoiseLanes; ++i) {
      const Eigen::Vector3d p(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y[i]),
                              static_cast<double>(lanes.z[i]));
      EXPECT_NEAR(static_cast<double>(values.value[i]), fractal_noise(p, 4, 23), 1e-4);
    }
  }
}

TEST(Material, AlbedoStaysWithinItsContrast) {
  for (const Grain grain : {Grain::plain, Grain::cardboard, Grain::foam, Grain::wood, Grain::stone, Grain::concrete,
                            Grain::paper, Grain::brick, Grain::metal}) {
    const Material material{.grain = grain, .albedo = 0.5, .contrast = 0.3, .grain_m = 0.01};
    double low = 1, high = 0;
    for (const Eigen::Vector3d& p : random_points(20000, 0.2)) {
      const double albedo = albedo_at(material, p, 17);
      low = std::min(low, albedo), high = std::max(high, albedo);
    }
    EXPECT_GE(low, 0.5 * 0.7 - 1e-7) << static_cast<int>(grain);
    EXPECT_LE(high, 0.5 * 1.3 + 1e-7) << static_cast<int>(grain);
    // A texture that uses less than half of its contrast yields no usable landmarks.
    if (grain != Grain::plain) {
      EXPECT_GT(high - low, 0.15) << static_cast<int>(grain);
    }
    if (grain == Grain::plain) {
      EXPECT_EQ(high, low);
    }
  }
}

}  // namespace
}  // namespace fringeslam::sim
