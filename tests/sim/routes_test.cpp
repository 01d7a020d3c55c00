// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/routes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

double distance(const Pose& a, const Pose& b) {
  const Pose step = a.inverse() * b;
  return translation_m(step) + rotation_rad(step);
}

TEST(Routes, ACameraLooksAtItsTargetUpright) {
  const Eigen::Vector3d eye(1, 2, 3), target(-1, 0.5, 0.2);
  const Pose pose = looking_at(eye, target);
  EXPECT_NEAR(pose.rotation.determinant(), 1, 1e-12);
  const Eigen::Vector3d seen = pose.inverse() * target;
  EXPECT_NEAR(seen.head<2>().norm(), 0, 1e-12);
  EXPECT_NEAR(seen.z(), (target - eye).norm(), 1e-12);
  EXPECT_NEAR(pose.rotation(2, 0), 0, 1e-12);  // image rows are horizontal
  EXPECT_LT(pose.rotation(2, 1), 0);           // image y points down
  const Pose down = looking_at({0, 0, 1}, {0, 0, 0});
  EXPECT_NEAR((down.rotation.transpose() * down.rotation - Eigen::Matrix3d::Identity()).norm(), 0, 1e-12);
  EXPECT_NEAR(down.rotation(0, 1), -1, 1e-12);  // the top of the image points towards +x
}

std::vector<Pose> waypoints() {
  return {pose_from({{0, 0, 0}, {0, 0, 0}}), pose_from({{300, 0, 50}, {0, 20, 90}}),
          pose_from({{320, 400, 0}, {10, 0, 170}}), pose_from({{-50, 380, -20}, {0, 0, -100}})};
}

TEST(Routes, ASplineGoesThroughItsWaypoints) {
  for (const bool closed : {false, true}) {
    const std::vector<Pose> route = sample_spline(waypoints(), 2001, closed);
    ASSERT_EQ(route.size(), 2001u);
    for (const Pose& waypoint : waypoints()) {
      double nearest = 1e9;
      for (const Pose& pose : route) nearest = std::min(nearest, distance(waypoint, pose));
      EXPECT_LT(nearest, 2e-3);
    }
    EXPECT_NEAR(distance(route.front(), waypoints().front()), 0, 1e-9);
    EXPECT_NEAR(distance(route.back(), closed ? waypoints().front() : waypoints().back()), 0, 1e-9);
  }
}

TEST(Routes, ASplineStepsEvenlyAndTurnsSmoothly) {
  const std::vector<Pose> route = sample_spline(waypoints(), 801, true, 1);
  const double mean = distance(route[0], route[1]);
  for (size_t i = 1; i < route.size(); ++i) EXPECT_NEAR(distance(route[i - 1], route[i]), mean, 0.01 * mean) << i;
  // No kinks, including at the closure: the direction changes little from step to step.
  for (size_t i = 1; i < route.size(); ++i) {
    const size_t next = i + 1 < route.size() ? i + 1 : 1;
    const Vector6d before = difference(route[i], route[i - 1]), after = difference(route[next], route[next - 1]);
    EXPECT_LT((after - before).norm(), 0.2 * before.norm()) << i;
  }
}

TEST(Routes, OnTwoWaypointsItIsTheStraightLine) {
  const std::vector<Pose> route = sample_spline({waypoints()[0], waypoints()[1]}, 11, false);
  for (int i = 0; i < 11; ++i)
    EXPECT_NEAR(distance(route[static_cast<size_t>(i)], interpolate(waypoints()[0], waypoints()[1], i / 10.0)), 0,
                1e-9);
}

TEST(Routes, AnOrbitLooksAtItsCentreFromItsRadius) {
  Orbit orbit;
  orbit.centre = {1, 2, 0.5};
  orbit.radius = 0.8;
  orbit.height = 0.6;
  orbit.from = -1;
  orbit.to = 2;
  orbit.count = 7;
  const std::vector<Pose> route = orbit_route(orbit);
  ASSERT_EQ(route.size(), 7u);
  for (const Pose& pose : route) {
    EXPECT_NEAR((pose.translation - orbit.centre).head<2>().norm(), 0.8, 1e-12);
    EXPECT_NEAR(pose.translation.z(), 1.1, 1e-12);
    EXPECT_NEAR((pose.inverse() * orbit.centre).head<2>().norm(), 0, 1e-12);
  }
  const Eigen::Vector3d first = route.front().translation - orbit.centre;
  EXPECT_NEAR(std::atan2(first.y(), first.x()), -1, 1e-12);
}

TEST(Routes, AWalkStaysWithinItsBoundsAndFillsThem) {
  RandomWalk walk;
  walk.start = pose_from({{100, 0, 0}, {0, 0, 30}});
  walk.count = 4000;
  walk.step = {0.05, 0.05, 0};
  walk.turn = {0.02, 0.02, 0.05};
  walk.max_turn = 0.3;
  walk.low = {-0.2, -0.1, 0};
  walk.high = {0.3, 0.4, 0};
  const std::vector<Pose> route = random_walk(walk, 3);
  ASSERT_EQ(route.size(), 4000u);
  EXPECT_EQ(route[0].translation, walk.start.translation);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Pose& pose : route) {
    EXPECT_TRUE((pose.translation.array() >= walk.low.array()).all() &&
                (pose.translation.array() <= walk.high.array()).all());
    EXPECT_LE(rotation_rad(walk.start.inverse() * pose), std::sqrt(3.0) * 0.3 + 1e-9);
    mean += pose.translation / 4000;
  }
  // After many reflections the positions are uniform, so their mean is the centre of the bounds.
  EXPECT_NEAR(mean.x(), 0.05, 0.05);
  EXPECT_NEAR(mean.y(), 0.15, 0.05);
  EXPECT_NE(random_walk(walk, 4)[1].translation, route[1].translation);
  EXPECT_EQ(random_walk(walk, 3)[3999].translation, route[3999].translation);
}

TEST(Routes, ABallBetweenTwoWalls) {
  EXPECT_DOUBLE_EQ(reflected(0.3, 0, 1), 0.3);
  EXPECT_DOUBLE_EQ(reflected(1.25, 0, 1), 0.75);
  EXPECT_DOUBLE_EQ(reflected(-0.25, 0, 1), 0.25);
  EXPECT_DOUBLE_EQ(reflected(2.25, 0, 1), 0.25);
  EXPECT_DOUBLE_EQ(reflected(5, 2, 2), 2);
}

}  // namespace
}  // namespace fringeslam::sim
