// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/stage.h"

#include <gmock/gmock.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/random.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::PoseNear;
using support::Random;
using testing::HasSubstr;

Pose pose_of(const Eigen::Vector3d& translation_mm, const Eigen::Vector3d& angles_deg) {
  return pose_from({translation_mm, angles_deg});
}

const Pose kTruth = pose_of({120, -40, 950}, {178, 4, -33});

// Identity, followed by eight motions about all axes.
std::vector<Pose> mixed_poses() {
  std::vector<Pose> poses = {Pose{}};
  for (const auto& [t, a] : std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>{{{30, 0, 0}, {0, 0, 10}},
                                                                                     {{-20, 25, 5}, {6, 0, -4}},
                                                                                     {{10, -30, 20}, {0, -9, 3}},
                                                                                     {{0, 15, -35}, {-7, 5, 0}},
                                                                                     {{20, 10, 10}, {3, 3, 12}},
                                                                                     {{-35, 5, -15}, {5, -6, -8}},
                                                                                     {{5, -20, 25}, {-4, 8, 2}},
                                                                                     {{15, 15, -20}, {9, -2, 5}}})
    poses.push_back(pose_of(t, a));
  return poses;
}

// 4 x 3 corners on the ground in the camera frame, with noise of the given covariance if `random` is given.
std::vector<StageView> views_of(const std::vector<Pose>& poses, const Eigen::Matrix3d& covariance, Random* random) {
  std::vector<StageView> views;
  for (const Pose& pose : poses) {
    StageView view{pose, {}};
    const Pose camera_from_world = (pose * kTruth).inverse();
    for (int i = 0; i < 12; ++i) {
      CornerPoint corner{camera_from_world * Eigen::Vector3d(0.1 + 0.02 * (i % 4), 0.02 * (i / 4) - 0.03, 0.01),
                         covariance};
      if (random) corner.point_m += random->gaussian<3>(covariance);
      view.corners.push_back(corner);
    }
    views.push_back(view);
  }
  return views;
}

const Eigen::Matrix3d kCovariance = Eigen::Vector3d(2e-5, 2e-5, 6e-5).cwiseAbs2().asDiagonal();

TEST(StageCalibration, IsExactWithoutNoise) {
  const StageCalibration result = calibrate_stage(views_of(mixed_poses(), kCovariance, nullptr));
  EXPECT_THAT(result.nearest_rigid, PoseNear(kTruth, 1e-8, 1e-8));
  EXPECT_THAT(result.robot_from_camera, PoseNear(kTruth, 1e-8, 1e-8));
  EXPECT_LT(result.affinity, 1e-8);
  EXPECT_LT(result.rms_m, 1e-9);
  EXPECT_EQ(result.motions, 8);
  EXPECT_EQ(result.corners, 12);
}

TEST(StageCalibration, CovarianceIsHonestAndBeatsTheTwelveUnknowns) {
  Random random(5);
  double nees = 0, linear = 0, refined = 0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    const StageCalibration result = calibrate_stage(views_of(mixed_poses(), kCovariance, &random));
    const Vector6d off = difference(result.robot_from_camera, kTruth);
    nees += off.dot(result.covariance.inverse() * off) / kTrials;
    linear += difference(result.nearest_rigid, kTruth).tail<3>().squaredNorm();
    refined += off.tail<3>().squaredNorm();
  }
  // The mean of 60 chi-squares with 6 degrees of freedom has a standard deviation of 0.45.
  EXPECT_NEAR(nees, 6, 1.4);
  EXPECT_LT(refined, linear);
}

TEST(StageCalibration, OneBadCornerDoesLittleHarm) {
  Random random(6);
  auto views = views_of(mixed_poses(), kCovariance, &random);
  views[3].corners[5]->point_m.z() += 0.004;
  views[6].corners[1].reset();
  EXPECT_THAT(calibrate_stage(views).robot_from_camera, PoseNear(kTruth, 4e-4, 4e-4));
}

// A corner that only one view shows says nothing, wherever it is.
TEST(StageCalibration, ACornerOfASingleViewChangesNothing) {
  Random random(7);
  const auto all = views_of(mixed_poses(), kCovariance, &random);
  auto never = all;
  for (StageView& view : never) view.corners[5].reset();
  auto once = never;
  once[3].corners[5] = all[3].corners[5];
  once[3].corners[5]->point_m.z() += 0.01;
  const StageCalibration expected = calibrate_stage(never), found = calibrate_stage(once);
  EXPECT_THAT(found.robot_from_camera, PoseNear(expected.robot_from_camera, 1e-9, 1e-9));
  EXPECT_TRUE(found.covariance.isApprox(expected.covariance, 1e-6));
  EXPECT_NEAR(found.rms_m, expected.rms_m, 1e-6 * expected.rms_m);
  EXPECT_EQ(found.corners, 11);
}

TEST(StageCalibration, MotionsThatDetermineTooLittleAreRefused) {
  const auto error = [](const std::vector<Pose>& poses) {
    return error_of([&] { calibrate_stage(views_of(poses, kCovariance, nullptr)); });
  };
  std::vector<Pose> shifts = {Pose{}}, turns = {Pose{}};
  for (int i = 1; i <= 6; ++i) {
    shifts.push_back(pose_of({10.0 * (i % 3), 8.0 * i, 15.0 * (i % 2)}, {0, 0, 0}));
    turns.push_back(pose_of({10.0 * (i % 3), 8.0 * i, 15.0 * (i % 2)}, {0, 0, 5.0 * i}));
  }
  EXPECT_THAT(error(shifts), HasSubstr("do not determine the camera's position"));
  EXPECT_THAT(error(turns), HasSubstr("do not determine the camera's position"));  // undetermined along the axis
  EXPECT_THAT(error({Pose{}, pose_of({10, 0, 0}, {5, 0, 0})}), HasSubstr("at least four"));
}

TEST(StageCalibration, PosesOfAnotherKindAreRefused) {
  const auto views = views_of(mixed_poses(), kCovariance, nullptr);
  const auto error = [&](const auto& change) {
    auto changed = views;
    change(changed);
    return error_of([&] { calibrate_stage(changed); });
  };
  const auto each = [](const auto& change) {
    return [change](std::vector<StageView>& list) {
      for (StageView& view : list) change(view.world_from_robot);
    };
  };
  EXPECT_THAT(error(each([](Pose& pose) { pose.translation *= 1000; })), HasSubstr("do not fit a rigid transform"));
  EXPECT_THAT(error(each([](Pose& pose) { pose = pose.inverse(); })), HasSubstr("do not fit a rigid transform"));
  EXPECT_THAT(error([](std::vector<StageView>& list) {
                for (size_t i = 0; i + 1 < list.size(); ++i) list[i].world_from_robot = list[i + 1].world_from_robot;
              }),
              HasSubstr("do not fit a rigid transform"));
}

TEST(CornerPoint, IsWhereTheRayMeetsThePlane) {
  const RigModel rig = support::small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.3, -1).normalized();
  const Frame frame = support::observe(support::plane(normal, normal.z()), rig, {}, 1e-12);
  const Eigen::Vector2d corner(60.37, 71.82);
  const auto point = corner_point(frame, rig.camera, corner, 6);
  ASSERT_TRUE(point);
  EXPECT_NEAR(normal.dot(point->point_m), normal.z(), 1e-6);
  EXPECT_LT((rig.camera.project(point->point_m) - corner).norm(), 1e-6);
  EXPECT_FALSE(corner_point(frame, rig.camera, {-30, -30}, 6));
}

TEST(CornerPoint, ItsCovarianceIsTheScatterOfItsDepth) {
  const RigModel rig = support::small_rig(false);
  Random random(7);
  constexpr int kTrials = 150;
  double squares = 0, predicted = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Frame frame = support::observe(support::plane({0, 0, -1}, -1), rig, {}, 2e-4, &random);
    const auto point = corner_point(frame, rig.camera, {66, 62}, 5);
    ASSERT_TRUE(point);
    squares += std::pow(point->point_m.z() - 1, 2) / kTrials;
    predicted += point->covariance_m2(2, 2) / kTrials;
  }
  EXPECT_NEAR(std::sqrt(squares / predicted), 1, 0.2);
}

// A left-handed system negates translations along an axis and rotations about the others, for example the y axis of images.
TEST(StageCalibration, PosesOfALeftHandedFrameAreRefused) {
  const auto views = views_of(mixed_poses(), kCovariance, nullptr);
  const std::vector<Eigen::Vector3d> reflections = {{-1, 1, 1}, {1, -1, 1}, {1, 1, -1}, {-1, -1, -1}};
  for (const Eigen::Vector3d& signs : reflections) {
    const auto mirror = signs.asDiagonal();
    auto mirrored = views;
    for (StageView& view : mirrored) {
      view.world_from_robot.rotation = mirror * view.world_from_robot.rotation * mirror;
      view.world_from_robot.translation = mirror * view.world_from_robot.translation;
    }
    EXPECT_THAT(error_of([&] { calibrate_stage(mirrored); }), HasSubstr("left-handed")) << signs.transpose();
    // The remedy, which need not choose the same axis.
    for (StageView& view : mirrored) {
      Pose& pose = view.world_from_robot;
      const Eigen::Vector3d turn = rotation_log(pose.rotation);
      pose.rotation = rotation_exp({-turn.x(), turn.y(), -turn.z()});
      pose.translation.y() *= -1;
    }
    EXPECT_LT(calibrate_stage(mirrored).affinity, 1e-8);
  }
}

// Neither the choice of the corner that is missing nor that of the world's origin says anything about the views. Errors that the
// corners of a view share determine the covariance.
TEST(StageCalibration, AMissingFirstCornerIsLikeAnyOther) {
  Random random(8);
  auto all = views_of(mixed_poses(), kCovariance, &random);
  for (StageView& view : all) {
    const Eigen::Vector3d shift = random.gaussian<3>(25 * kCovariance);
    for (auto& corner : view.corners) corner->point_m += shift;
  }
  const auto without = [&](size_t corner) {
    auto views = all;
    for (size_t i = 1; i < views.size(); ++i) views[i].corners[corner].reset();
    return views;
  };
  const auto sigmas = [](const std::vector<StageView>& views) -> Vector6d {
    return calibrate_stage(views).covariance.diagonal().cwiseSqrt();
  };
  const Vector6d complete = sigmas(all);
  for (const size_t corner : {0u, 5u})
    for (int i = 0; i < 6; ++i) EXPECT_NEAR(sigmas(without(corner))[i] / complete[i], 1, 0.1) << corner;
  auto moved = without(0);
  for (StageView& view : moved)
    view.world_from_robot = pose_of({900, -700, 1500}, {20, -10, 40}) * view.world_from_robot;
  EXPECT_TRUE(sigmas(moved).isApprox(sigmas(without(0)), 1e-4));
}

}  // namespace
}  // namespace fringeslam
