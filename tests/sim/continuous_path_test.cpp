// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/continuous_path.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/types/error.h"
#include "sim/scene/routes.h"

namespace fringeslam::sim {
namespace {

std::vector<Pose> straight(int count, double step_m) {
  std::vector<Pose> poses;
  for (int i = 0; i < count; ++i) poses.push_back({Eigen::Matrix3d::Identity(), {step_m * i, 0, 0}});
  return poses;
}

TEST(ContinuousPath, ReproducesConstantVelocity) {
  const Eigen::Vector3d turn(0.02, -0.01, 0.03), step(0.01, 0.02, -0.005);
  std::vector<Pose> controls;
  for (int i = 0; i < 10; ++i) controls.push_back({rotation_exp(i * turn), i * step});
  const ContinuousPath path(controls, 0.1, {}, 0);
  for (const double time_s : {-0.05, 0.0, 0.123, 0.5, 0.87, 0.95}) {
    const Pose expected{rotation_exp(time_s / 0.1 * turn), time_s / 0.1 * step};
    const Pose found = path.at(time_s);
    EXPECT_LT(difference(found, expected).norm(), 1e-12) << time_s;
  }
}

// A C^2 curve's third difference is O(h^3); a jump of the second derivative would leave O(h^2).
TEST(ContinuousPath, HasContinuousAcceleration) {
  std::vector<Pose> controls;
  for (int i = 0; i < 12; ++i)
    controls.push_back({rotation_exp({0.1 * std::sin(1.7 * i), 0.1 * i, 0}), {std::cos(2.0 * i), 0.3 * i, 0}});
  const ContinuousPath path(controls, 0.05, {}, 0);
  const double h = 1e-4;
  for (double time_s = 0.1; time_s < 0.5; time_s += 0.05) {  // knots
    const auto second = [&](double t) -> Eigen::Vector3d {
      return (path.at(t + h).translation - 2 * path.at(t).translation + path.at(t - h).translation) / (h * h);
    };
    EXPECT_LT((second(time_s + h) - second(time_s - h)).norm(), 0.05 * second(time_s).norm() + 10) << time_s;
  }
}

TEST(ContinuousPath, VibrationHasItsAmplitude) {
  const ContinuousPath path(straight(4, 0), 10, {1e-3, 2e-3, 5, 40}, 7);
  double shift = 0, turn = 0;
  constexpr int kSamples = 20000;
  for (int i = 0; i < kSamples; ++i) {
    const Pose pose = path.at(30.0 * i / kSamples);
    shift += pose.translation.squaredNorm();
    turn += rotation_log(pose.rotation).squaredNorm();
  }
  EXPECT_NEAR(std::sqrt(shift / kSamples), 1e-3, 1e-4);
  EXPECT_NEAR(std::sqrt(turn / kSamples), 2e-3, 2e-4);
}

TEST(Travelled, KeepsSpeedAndAcceleration) {
  Travel travel;
  travel.speed_m_s = 0.5;
  travel.acceleration_m_s2 = 1;
  travel.from_rest = true;
  const double step_s = 0.02;
  const std::vector<Pose> poses = travelled(straight(100, 0.02), travel, step_s);
  double last = 0;
  for (size_t i = 1; i < poses.size(); ++i) {
    const double speed = (poses[i].translation - poses[i - 1].translation).norm() / step_s;
    EXPECT_LE(speed, travel.speed_m_s + 1e-9);
    EXPECT_LE(std::abs(speed - last), travel.acceleration_m_s2 * step_s + 1e-9);
    last = speed;
  }
  EXPECT_NEAR(last, travel.speed_m_s, 1e-9);
  EXPECT_GE(poses.back().translation.x(), 1.98);
  EXPECT_LT(poses[poses.size() - 2].translation.x(), 1.98);
}

// Also where the route ends within an interval of the spline.
TEST(Travelled, KeepsItsSpeedToTheEndOfThePath) {
  const Travel travel;
  constexpr double kKnot_s = 0.05, kH_s = 1e-3;
  for (const double step_m : {0.02, 0.0203, 0.0207}) {
    const ContinuousPath path(travelled(straight(50, step_m), travel, kKnot_s), kKnot_s, {}, 0);
    for (double time_s = path.duration_s() - 0.3; time_s < path.duration_s(); time_s += 0.005) {
      const Eigen::Vector3d before = path.at(time_s - kH_s).translation, at = path.at(time_s).translation,
                            after = path.at(time_s + kH_s).translation;
      EXPECT_NEAR((after - at).norm() / kH_s, travel.speed_m_s, 1e-9) << time_s;
      EXPECT_LE((after - 2 * at + before).norm() / (kH_s * kH_s), travel.acceleration_m_s2) << time_s;
    }
  }
}

// A route shorter than a step.
TEST(Travelled, HasAtLeastTwoPoses) {
  const std::vector<Pose> poses = travelled(straight(2, 1e-4), {}, 0.05);
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_NEAR(poses[1].translation.x(), 0.05 * Travel().speed_m_s, 1e-9);
}

// A circle of radius r is travelled at v^2 / r = a.
TEST(Travelled, SlowsDownInCircles) {
  Travel travel;
  travel.speed_m_s = 1;
  travel.max_rad_s = 100;
  travel.acceleration_m_s2 = 0.8;
  const double radius_m = 0.2, step_s = 0.01;
  std::vector<Pose> route;
  for (int i = 0; i <= 2000; ++i) {
    const double angle = 2e-3 * i;
    route.push_back({Eigen::Matrix3d::Identity(), radius_m * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0)});
  }
  const std::vector<Pose> poses = travelled(route, travel, step_s);
  for (size_t i = 1; i < poses.size(); ++i)
    EXPECT_NEAR((poses[i].translation - poses[i - 1].translation).norm() / step_s, 0.4, 1e-4);
}

TEST(Travelled, BoundsTotalAccelerationsOnWindingRoutes) {
  Travel travel;
  travel.speed_m_s = 1;
  travel.acceleration_m_s2 = 0.7;
  travel.max_rad_s = 0.8;
  const double step_s = 0.01;
  std::vector<Pose> route;
  for (int i = 0; i <= 8000; ++i) {
    const double t = 2.5e-4 * i;
    route.push_back({rotation_exp({0.2 * std::sin(9 * t), 0, 0.3 * std::sin(6 * t)}),
                     {t, 0.1 * std::sin(12 * t), 0.02 * std::cos(20 * t)}});
  }
  const std::vector<Pose> poses = travelled(route, travel, step_s);
  double fastest = 0, most_m_s2 = 0, most_rad_s2 = 0;
  for (size_t i = 1; i + 1 < poses.size(); ++i) {
    const Pose &a = poses[i - 1], &b = poses[i], &c = poses[i + 1];
    fastest = std::max(fastest, (c.translation - b.translation).norm() / step_s);
    most_m_s2 = std::max(most_m_s2, (a.translation - 2 * b.translation + c.translation).norm() / (step_s * step_s));
    const Eigen::Vector3d before = rotation_log(b.rotation * a.rotation.transpose()),
                          after = rotation_log(c.rotation * b.rotation.transpose());
    most_rad_s2 = std::max(most_rad_s2, (after - before).norm() / (step_s * step_s));
  }
  EXPECT_LE(most_m_s2, 1.03 * travel.acceleration_m_s2);
  EXPECT_LE(most_rad_s2, 1.03 * travel.acceleration_m_s2 * travel.max_rad_s / travel.speed_m_s);
  // The bound is used, not only kept.
  EXPECT_GE(std::max(most_m_s2 / travel.acceleration_m_s2,
                     most_rad_s2 / (travel.acceleration_m_s2 * travel.max_rad_s / travel.speed_m_s)),
            0.9);
  EXPECT_GT(fastest, 0.3);
}

TEST(Travelled, TurnsNoFasterThanAllowed) {
  Travel travel;
  travel.max_rad_s = 0.2;
  std::vector<Pose> route;
  for (int i = 0; i < 50; ++i) route.push_back({rotation_exp({0, 0, 0.01 * i}), {0.001 * i, 0, 0}});
  const std::vector<Pose> poses = travelled(route, travel, 0.05);
  for (size_t i = 1; i < poses.size(); ++i)
    EXPECT_LE(rotation_rad(poses[i - 1].inverse() * poses[i]), 0.2 * 0.05 + 1e-9);
}

TEST(Travelled, StopsAndGoes) {
  Travel travel;
  travel.move_s = 0.5;
  travel.stop_s = 0.3;
  travel.acceleration_m_s2 = 100;
  const std::vector<Pose> poses = travelled(straight(100, 0.02), travel, 0.01);
  EXPECT_LT((poses[29].translation - poses[0].translation).norm(), 1e-9);
  EXPECT_NEAR((poses[70].translation - poses[40].translation).norm(), 0.3 * 0.3, 5e-3);
  EXPECT_LT((poses[108].translation - poses[86].translation).norm(), 1e-9);
}

// A path that would exhaust the memory, such as one whose timestamps are in nanoseconds, is an error.
TEST(Travelled, PathsOfEndlessDurationAreRefused) {
  Travel travel;
  travel.speed_m_s = 0.1;
  travel.move_s = 0.01;
  travel.stop_s = 1e4;
  EXPECT_THROW((void)travelled(straight(10, 0.1), travel, 0.05), Error);
  EXPECT_THROW((void)resampled({{0, {}}, {1e11, {}}}, 0.05), Error);
  EXPECT_THROW((void)resampled({{0, {}}, {1e300, {}}}, 0.05), Error);
}

TEST(Resampled, PassesThroughTheTimedPoses) {
  Trajectory timed;
  for (int i = 0; i < 6; ++i)
    timed.push_back({10 + 0.1 * i * i, {rotation_exp({0, 0.1 * i, 0}), {0.1 * i, 0, 0.01 * i * i}}});
  const std::vector<Pose> poses = resampled(timed, 0.1);
  for (int i = 0; i < 6; ++i)
    EXPECT_LT(difference(poses[static_cast<size_t>(i * i)], timed[static_cast<size_t>(i)].world_from_robot).norm(),
              1e-9);
}

TEST(Resampled, KeepsItsVelocityBeyondTheLastTimedPose) {
  const Eigen::Vector3d turn(0.02, -0.01, 0.03), step(0.01, 0.02, -0.005);
  for (const int count : {2, 7}) {
    Trajectory timed;
    for (int i = 0; i < count; ++i) timed.push_back({10 + 0.03 * i, {rotation_exp(i * turn), i * step}});
    const std::vector<Pose> poses = resampled(timed, 0.05);
    ASSERT_EQ(poses.size(), count == 2 ? 2u : 5u);
    for (size_t i = 0; i < poses.size(); ++i) {
      const double steps = static_cast<double>(i) * 0.05 / 0.03;
      EXPECT_LT(difference(poses[i], {rotation_exp(steps * turn), steps * step}).norm(), 1e-9) << i;
    }
  }
}

}  // namespace
}  // namespace fringeslam::sim
