// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/motion_predictor.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "core/mapper/vibration.h"

namespace fringeslam {
namespace {

constexpr double kInterval_s = 1.0 / 30, kNoise_m = 10e-6, kNoise_rad = 10e-6;

// Poses at 30 Hz of a camera with the given position over time, with noise.
template <class Position>
std::vector<PoseSample> samples_of(int count, const Position& position, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto noise = [&](double sigma) {
    return Eigen::Vector3d(sigma * normal(random), sigma * normal(random), sigma * normal(random));
  };
  std::vector<PoseSample> samples;
  for (int i = 0; i < count; ++i) {
    const double t = kInterval_s * i;
    const Pose pose{rotation_exp(Eigen::Vector3d(0, 0.2 * t, 0) + noise(kNoise_rad)), position(t) + noise(kNoise_m)};
    samples.push_back({t, pose, {kNoise_rad * kNoise_rad, kNoise_m * kNoise_m}, {}});
  }
  return samples;
}

Eigen::Vector3d smooth(double t) { return {0.3 * t, 0.02 * t * t, 0}; }

TEST(MotionPredictor, PredictsSmoothMotionWithinItsSigmas) {
  double squares = 0, widest_m = 0, widest_m_s = 0;
  constexpr int kSeeds = 50, kViews = 10;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const auto samples = samples_of(kViews, smooth, static_cast<uint64_t>(seed));
    const double t = kInterval_s * kViews;
    const auto predicted = predict_motion(samples, t, {});
    ASSERT_TRUE(predicted);
    const Eigen::Vector3d error = predicted->world_from_camera.translation - smooth(t);
    squares += error.squaredNorm() / (3 * predicted->shift_m * predicted->shift_m) / kSeeds;
    widest_m = std::max(widest_m, predicted->shift_m);
    const double sigma_m_s = std::sqrt(predicted->motion.covariance(3, 3));
    widest_m_s = std::max(widest_m_s, sigma_m_s);
    const Eigen::Vector3d velocity = predicted->world_from_camera.rotation * predicted->motion.motion.velocity_m_s;
    EXPECT_LT((velocity - Eigen::Vector3d(0.3, 0.04 * t, 0)).norm(), 6 * sigma_m_s) << seed;
  }
  EXPECT_LT(squares, 1.5);
  EXPECT_GT(squares, 0.05);
  EXPECT_LT(widest_m, 0.5e-3);
  EXPECT_LT(widest_m_s, 0.02);
}

TEST(MotionPredictor, PredictsJerkyMotionWidely) {
  const auto shaking = [](double t) { return Eigen::Vector3d(0.3 * t + 2e-3 * std::sin(60 * t), 0, 0); };
  const double t = kInterval_s * 10;
  const auto calm = predict_motion(samples_of(10, smooth, 1), t, {}),
             wild = predict_motion(samples_of(10, shaking, 1), t, {});
  ASSERT_TRUE(calm && wild);
  EXPECT_GT(wild->shift_m, 10 * calm->shift_m);
  EXPECT_LT((wild->world_from_camera.translation - shaking(t)).norm(), 4 * wild->shift_m);
}

TEST(MotionPredictor, NeedsTwoPosesOrAMotion) {
  EXPECT_FALSE(predict_motion({}, 1, {}));
  std::vector<PoseSample> one = samples_of(1, smooth, 1);
  EXPECT_FALSE(predict_motion(one, 0.1, {}));
  one[0].motion.emplace();
  one[0].motion->motion.velocity_m_s = {0.3, 0, 0};
  one[0].motion->covariance.diagonal().setConstant(1e-4);
  const auto predicted = predict_motion(one, 0.1, {});
  ASSERT_TRUE(predicted);
  EXPECT_NEAR(predicted->world_from_camera.translation.x(), 0.03, 1e-4);
  // 10 mm/s and 0.5 m/s^2 over 0.1 s, and the jerk.
  EXPECT_GT(predicted->shift_m, std::hypot(1e-3, 2.5e-3));
  EXPECT_LT(predicted->shift_m, 5e-3);
  EXPECT_FALSE(predict_motion(one, 2, {})) << "too far ahead";
}

// Samples of a smooth path with independent displacements of each image, three of which make a view.
std::vector<PoseSample> shaken_samples(int count, double jitter_m, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto shaken = [&](double t) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (int image = 0; image < 3; ++image) mean += Eigen::Vector3d(normal(random), normal(random), normal(random)) / 3;
    return Eigen::Vector3d(smooth(t) + jitter_m * mean);
  };
  return samples_of(count, shaken, seed + 1000);
}

TEST(Vibration, IsFoundInPosesThatScatter) {
  constexpr double kImages_hz = 90;
  for (const double jitter_m : {5e-5, 1e-4, 4e-4}) {
    double square = 0;
    int certain = 0;
    constexpr int kSeeds = 30;
    for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const VibrationEstimate found = estimate_vibration(shaken_samples(8, jitter_m, seed), {}, kImages_hz);
      square += found.expected.shift_m * found.expected.shift_m / kSeeds;
      certain += found.least.shift_m > 0;
      EXPECT_LE(found.least.shift_m, 2 * jitter_m) << seed;
    }
    EXPECT_GT(std::sqrt(square), 0.7 * jitter_m);
    EXPECT_LT(std::sqrt(square), 2 * jitter_m);
    EXPECT_GE(certain, kSeeds - 3) << jitter_m;
  }
}

TEST(Vibration, IsExcludedByManySmoothPosesOnly) {
  constexpr double kImages_hz = 90;
  for (uint64_t seed = 1; seed <= 30; ++seed) {
    const std::vector<PoseSample> samples = samples_of(8, smooth, seed);
    EXPECT_LT(estimate_vibration(samples, {}, kImages_hz).expected.shift_m, 2 * kNoise_m) << seed;
    EXPECT_EQ(estimate_vibration(samples, {}, kImages_hz).least.shift_m, 0) << seed;
    const std::vector<PoseSample> few(samples.begin(), samples.begin() + 2);
    EXPECT_GT(estimate_vibration(few, {}, kImages_hz).expected.shift_m, 2e-4) << seed;
  }
  EXPECT_EQ(estimate_vibration({}, {}, kImages_hz).expected.shift_m, 0);
}

// In a widened prior, depths leave some directions of the motion to chance. Their errors are no vibration.
TEST(Vibration, IsNotFoundInErrorsOfTheEstimatedMotion) {
  constexpr double kCertain = 1e-3, kUncertain = 2e-2;  // m/s or rad/s, standard deviations of the estimate
  const Matrix12d of_prediction = 1e-6 * Matrix12d::Identity();
  Matrix12d of_motion = kCertain * kCertain * Matrix12d::Identity();
  of_motion(2, 2) = of_motion(5, 5) = kUncertain * kUncertain;
  const auto found = [&](int direction, double change) {
    Vibration vibration(90);
    vibration.begin_view(1 / 30.0);
    return vibration.note(change * Vector12d::Unit(direction), of_prediction, of_motion);
  };
  for (const int uncertain : {2, 5}) {
    EXPECT_FALSE(found(uncertain, 2 * kUncertain));
    EXPECT_TRUE(found(uncertain, 8 * kUncertain));
    EXPECT_TRUE(found(uncertain - 2, 2 * kUncertain));
    EXPECT_FALSE(found(uncertain - 2, 8 * kCertain));  // smaller than vibration that matters
  }
}

}  // namespace
}  // namespace fringeslam
