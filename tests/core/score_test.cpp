// SPDX-License-Identifier: Apache-2.0
#include "core/score/score.h"

#include <gmock/gmock.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <limits>
#include <numbers>

#include "core/depth/depth.h"
#include "core/score/pose_honesty.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::MatrixNear;
using support::Random;
using testing::ElementsAre;
using testing::Pair;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kLit = kTruthSurface | kTruthInBeam;

TEST(Quantiles, InterpolateBetweenOrderStatistics) {
  EXPECT_EQ(median_of({5, 1, 3}), 3);
  EXPECT_EQ(median_of({4, 1, 3, 2}), 2.5);
  EXPECT_EQ(median_of({7}), 7);
  EXPECT_EQ(quantile_of({30, 10, 20}, 0), 10);
  EXPECT_EQ(quantile_of({30, 10, 20}, 1), 30);
  EXPECT_DOUBLE_EQ(quantile_of({30, 10, 20, 40, 50}, 0.6), 34);  // position 2.4
  EXPECT_TRUE(std::isnan(median_of({})));
}

cv::Mat1f row_of(const std::vector<float>& values) { return cv::Mat1f(values, true).reshape(1, 1); }

TEST(DepthScore, ByHand) {
  //                     exact  1 mm  -3 mm  wrong K  lost  shadow  off beam  no surface
  const DepthEstimate estimate = {.depth_m = row_of({1.0F, 1.001F, 0.997F, 1.02F, kNaN, 1.0F, 1.0F, 1.0F}),
                                  .sigma_m = row_of(std::vector<float>(8, 1e-4F)),
                                  .projector_column = row_of({100, 100.9F, 107.9F, 116, kNaN, 100, 100, 100})};
  TruthFrame truth;
  truth.depth_m = row_of({1, 1, 1, 1, 1, 1, 1, kNaN});
  truth.projector_column = row_of({100, 100, 100, 100, 100, 100, kNaN, kNaN});
  truth.mask = row_of({kLit, kLit, kLit, kLit, kLit, kLit | kTruthInShadow, kTruthSurface, 0});
  const DepthScore score = score_depth(estimate, truth, 16);
  EXPECT_EQ(score.compared, 4);
  EXPECT_NEAR(score.median_m, 0.002, 1e-7);
  EXPECT_NEAR(score.rms_m, std::sqrt((1 + 9 + 400) / 4.0) * 1e-3, 1e-7);
  EXPECT_NEAR(score.p99_m, 0.003 + 0.97 * 0.017, 1e-7);
  EXPECT_EQ(score.valid_fraction, 0.8);
  EXPECT_EQ(score.wrong_order, 0.25);
  EXPECT_EQ(score.spurious, 3);
}

TEST(DepthScore, OnAnEdgeBothSurfacesAreRight) {
  TruthFrame truth;
  truth.depth_m = row_of({1, 1, 1, 2, 2});
  truth.projector_column = row_of({100, 101, 102, 300, 301});
  truth.mask = row_of({kLit, kLit | kTruthMixed, kLit | kTruthMixed, kLit | kTruthMixed, kLit});
  const auto wrong = [&](const std::vector<float>& columns) {
    return score_depth({truth.depth_m, row_of(std::vector<float>(5, 1e-4F)), row_of(columns)}, truth, 16).wrong_order;
  };
  EXPECT_EQ(wrong({100, 101, 299, 103, 301}), 0);    // a surface on either side of the edge, at the edge
  EXPECT_EQ(wrong({100, 299, 102, 300, 301}), 0.2);  // the other surface, two pixels away from it
  EXPECT_EQ(wrong({100, 101, 200, 300, 301}), 0.2);  // neither surface
  EXPECT_EQ(wrong({300, 101, 102, 300, 301}), 0.2);  // not at an edge
}

TEST(DepthScore, NothingMeasured) {
  const DepthEstimate estimate = {row_of({kNaN}), row_of({kNaN}), row_of({kNaN})};
  TruthFrame truth;
  truth.depth_m = truth.projector_column = row_of({1});
  truth.mask = row_of({kLit});
  const DepthScore score = score_depth(estimate, truth, 16);
  EXPECT_EQ(score.compared, 0);
  EXPECT_EQ(score.valid_fraction, 0);
  EXPECT_EQ(score.spurious, 0);
  truth.depth_m = row_of({1, 1});
  EXPECT_THAT(error_of([&] { score_depth(estimate, truth, 16); }), testing::HasSubstr("differ in size"));
}

TEST(DepthScore, CoordinatesOfAnotherSizeAreAnError) {
  TruthFrame truth;
  truth.depth_m = truth.projector_column = row_of({1, 1});
  truth.mask = row_of({kLit, kLit});
  for (const cv::Mat1f& columns : {cv::Mat1f(), row_of({100})}) {
    const DepthEstimate estimate = {row_of({1.1F, 1.1F}), row_of({1e-4F, 1e-4F}), columns};
    EXPECT_THAT(error_of([&] { score_depth(estimate, truth, 16); }), testing::HasSubstr("differ in size"));
  }
}

TEST(Associate, NearestTimestampsWithinTheGap) {
  const Trajectory truth = {{0.0, {}}, {0.1, {}}, {0.2, {}}, {0.3, {}}};
  const Trajectory estimate = {{-0.5, {}}, {0.098, {}}, {0.15, {}}, {0.3095, {}}, {0.5, {}}};
  EXPECT_THAT(associate(estimate, truth), ElementsAre(Pair(1, 1), Pair(3, 3)));
  EXPECT_THAT(associate(estimate, truth, 0.001), testing::IsEmpty());
  EXPECT_THAT(associate({}, truth), testing::IsEmpty());
  EXPECT_THAT(associate(estimate, {}), testing::IsEmpty());
}

// Five poses 0.1 m apart along x, each rotated slightly further about z.
Trajectory straight(double step_m, double turn_rad) {
  Trajectory trajectory;
  for (int i = 0; i < 5; ++i) trajectory.push_back({0.1 * i, {rotation_exp({0, 0, turn_rad * i}), {step_m * i, 0, 0}}});
  return trajectory;
}

Trajectory moved(const Pose& by, Trajectory trajectory) {
  for (TimedPose& pose : trajectory) pose.world_from_robot = by * pose.world_from_robot;
  return trajectory;
}

TEST(TrajectoryScore, AnotherWorldFrameIsNoError) {
  for (const Pose& by :
       {Pose{}, Pose{Eigen::Matrix3d::Identity(), {1, 2, 3}}, Pose{rotation_exp({1, 2, 0.5}), {4, 5, 6}}}) {
    const TrajectoryScore score = score_trajectory(moved(by, straight(0.1, 0.2)), straight(0.1, 0.2));
    EXPECT_EQ(score.poses, 5);
    EXPECT_NEAR(score.ate_rmse_m, 0, 1e-14);
    EXPECT_NEAR(score.ate_umeyama_rmse_m, 0, 1e-14);
    EXPECT_NEAR(score.rpe_translation_rmse_m, 0, 1e-14);
    EXPECT_NEAR(score.rpe_rotation_rmse_rad, 0, 1e-14);
  }
}

TEST(TrajectoryScore, DriftInScale) {
  // Errors 0, 1, 2, 3, 4 mm relative to the first pose; -2 .. 2 mm relative to the middle pose; 1 mm per step.
  const TrajectoryScore score = score_trajectory(straight(0.101, 0), straight(0.1, 0));
  EXPECT_NEAR(score.ate_rmse_m, 1e-3 * std::sqrt(30.0 / 5), 1e-12);
  EXPECT_NEAR(score.ate_umeyama_rmse_m, 1e-3 * std::sqrt(10.0 / 5), 1e-12);
  EXPECT_NEAR(score.rpe_translation_rmse_m, 1e-3, 1e-12);
  EXPECT_NEAR(score.rpe_rotation_rmse_rad, 0, 1e-12);
}

TEST(TrajectoryScore, DriftInHeading) {
  // Positions are correct, each step turns 10 mrad too far. Pose k sees the next step 10 k mrad too far to the right.
  const TrajectoryScore score = score_trajectory(straight(0.1, 0.01), straight(0.1, 0));
  EXPECT_NEAR(score.ate_rmse_m, 0, 1e-12);
  EXPECT_NEAR(score.rpe_rotation_rmse_rad, 0.01, 1e-12);
  double squares = 0;
  for (int k = 0; k < 4; ++k) squares += std::pow(2 * 0.1 * std::sin(0.005 * k), 2);
  EXPECT_NEAR(score.rpe_translation_rmse_m, std::sqrt(squares / 4), 1e-12);
}

TEST(TrajectoryScore, AWrongFirstHeadingSwingsTheAlignedPath) {
  // --align_origin aligns the full first pose: a heading error of 10 mrad there rotates a straight path by the same
  // angle.
  Trajectory estimate = straight(0.1, 0);
  estimate[0].world_from_robot.rotation = rotation_exp({0, 0, 0.01});
  const TrajectoryScore score = score_trajectory(estimate, straight(0.1, 0));
  EXPECT_NEAR(score.ate_rmse_m, 2 * std::sin(0.005) * 0.1 * std::sqrt(30.0 / 5), 1e-12);
  EXPECT_NEAR(score.ate_umeyama_rmse_m, 0, 1e-12);
}

TEST(TrajectoryScore, NeedsTwoPoses) {
  Trajectory late = straight(0.1, 0);
  for (TimedPose& pose : late) pose.timestamp_s += 0.38;
  EXPECT_THAT(error_of([&] { score_trajectory(late, straight(0.1, 0)); }), testing::HasSubstr("only 0 poses"));
}

TEST(MotionScore, DifferencesOfTheSixNumbers) {
  const MotionScore score =
      score_motion(pose_from({{30.04, 10.2, -15.21}, {179.9, 0.1, 0}}), pose_from({{30, 10, -15}, {-179.9, 0.1, 0}}));
  EXPECT_THAT(score.error.translation_mm, MatrixNear(Eigen::Vector3d(0.04, 0.2, -0.21), 1e-9));
  EXPECT_THAT(score.error.angles_deg, MatrixNear(Eigen::Vector3d(-0.2, 0, 0), 1e-9));
  EXPECT_NEAR(score.translation_error_m, 1e-3 * std::sqrt(0.04 * 0.04 + 0.2 * 0.2 + 0.21 * 0.21), 1e-12);
  EXPECT_NEAR(score.rotation_error_rad, 0.2 * std::numbers::pi / 180, 1e-12);
}

// A sigma of 1 mm along each axis and of 1 mrad about each.
Matrix6d millimetres_and_milliradians() { return 1e-6 * Matrix6d::Identity(); }

TEST(PoseHonesty, DisplacementIsThatOfThePointsAtTheMiddleOfTheRange) {
  RigModel rig;
  rig.camera = {100, 80, 100, 100, 49.5, 39.5, {}};
  rig.near_m = 1, rig.far_m = 3;
  const Pose truth = pose_from({{500, -20, 30}, {10, 20, 30}});
  // A shift along the axis moves all points alike; a turn about the axis moves only those on the corner rays, which are
  // 2 m * hypot(0.5, 0.4) from it.
  const PoseHonesty shifted = pose_honesty(truth * Pose{Eigen::Matrix3d::Identity(), {0, 0, 0.003}}, truth,
                                           millimetres_and_milliradians(), rig);
  EXPECT_NEAR(shifted.off_m, 0.003, 1e-12);
  EXPECT_NEAR(shifted.sigmas(), 3, 1e-3);
  const PoseHonesty turned =
      pose_honesty(truth * Pose{rotation_exp({0, 0, 0.004}), {0, 0, 0}}, truth, millimetres_and_milliradians(), rig);
  EXPECT_NEAR(turned.off_m, 2 * std::sin(0.002) * 2 * std::hypot(0.5, 0.4), 1e-12);
  EXPECT_NEAR(turned.sigmas(), 4, 1e-3);
}

TEST(PoseHonesty, ConfidentlyWrongIsFarOffInMillimetresAndInSigmas) {
  RigModel rig;
  rig.camera = {100, 80, 100, 100, 49.5, 39.5, {}};
  const auto wrong_with = [&](double off_mm, const Matrix6d& covariance) {
    return pose_honesty({Eigen::Matrix3d::Identity(), {1e-3 * off_mm, 0, 0}}, {}, covariance, rig).confidently_wrong();
  };
  const auto wrong = [&](double off_mm, double sigma_mm) {
    return wrong_with(off_mm, sigma_mm * sigma_mm * millimetres_and_milliradians());
  };
  EXPECT_TRUE(wrong(2, 0.19));
  EXPECT_FALSE(wrong(2, 0.21));    // not 10 sigmas
  EXPECT_FALSE(wrong(0.9, 0.01));  // not 1 mm
  EXPECT_TRUE(wrong(2, kNaN));
  EXPECT_TRUE(wrong(kNaN, 1));
  EXPECT_TRUE(wrong_with(2, Matrix6d::Zero()));
  Vector6d indefinite = Vector6d::Constant(1e-6);
  indefinite[0] = -1e-6;
  EXPECT_TRUE(wrong_with(2, indefinite.asDiagonal()));
  EXPECT_TRUE(wrong_with(2, -millimetres_and_milliradians()));
}

Matrix6d information_of(const support::Surface& surface, const RigModel& rig, const Pose& motion, double sigma_m) {
  const cv::Mat1f sigma(rig.camera.height, rig.camera.width, static_cast<float>(sigma_m));
  return pose_information(truth_of(surface, rig, {}), sigma, truth_of(surface, rig, motion), sigma, rig.camera,
                          pixel_rays(rig.camera), motion);
}

TEST(PoseInformation, OfOnePixel) {
  // On the axis and facing the camera, only depth is constrained, by 1 / (s_A^2 + s_B^2).
  RigModel rig = support::small_rig(false);
  rig.camera = {1, 1, 500, 500, 0, 0, {}};
  const auto truth = truth_of(support::plane({0, 0, 1}, 2), rig, {});
  const Matrix6d information =
      pose_information(truth, row_of({3e-4F}), truth, row_of({4e-4F}), rig.camera, pixel_rays(rig.camera), Pose{});
  Matrix6d expected = Matrix6d::Zero();
  expected(5, 5) = 1 / (5e-4 * 5e-4);
  EXPECT_THAT(information, MatrixNear(expected, 1));
  EXPECT_TRUE(std::isnan(error_over_bound(Pose{}, Pose{}, information)));
  const Matrix6d without =
      pose_information(truth, row_of({kNaN}), truth, row_of({4e-4F}), rig.camera, pixel_rays(rig.camera), Pose{});
  EXPECT_EQ(without, Matrix6d::Zero());
}

TEST(PoseInformation, SigmaIsThatAlongTheNormal) {
  // Tilted by 60 degrees: n.d = 1/2, so the sigma along the normal is half the depth sigma.
  RigModel rig = support::small_rig(false);
  rig.camera = {1, 1, 500, 500, 0, 0, {}};
  const Eigen::Vector3d normal(std::sqrt(0.75), 0, -0.5);
  const Matrix6d information = information_of(support::plane(normal, -1), rig, {}, 1e-4);  // depth 2
  Vector6d g;
  g << Eigen::Vector3d(0, 0, 2).cross(normal), normal;
  const Matrix6d expected = g * g.transpose() / (2 * 0.25e-8);
  EXPECT_THAT(information, MatrixNear(expected, 1e-5 * expected.cwiseAbs().maxCoeff()));
}

TEST(PoseInformation, RankIsThatOfTheSurface) {
  const RigModel rig = support::small_rig(false);
  const Pose motion = pose_from({{10, -5, 8}, {1, 1, 2}});
  const auto rank = [&](const support::Surface& surface) {
    const Matrix6d information = information_of(surface, rig, motion, 1e-4);
    const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
    return (eigen.eigenvalues().array() > 1e-6 * eigen.eigenvalues().maxCoeff()).count();
  };
  EXPECT_EQ(rank(support::plane({0.2, 0.1, 1}, 1)), 3);
  EXPECT_EQ(rank(support::corner({0, 0, 1.1})), 6);
}

TEST(PoseInformation, PixelsThatHoldAnEdgeAreLeftOut) {
  RigModel rig = support::small_rig(false);
  rig.camera = {1, 1, 500, 500, 0, 0, {}};
  const auto clear = truth_of(support::plane({0, 0, 1}, 2), rig, {});
  auto mixed = truth_of(support::plane({0, 0, 1}, 2), rig, {});
  mixed.mask(0, 0) += static_cast<float>(kTruthMixed);
  const cv::Mat1f sigma = row_of({1e-4F});
  const PixelRays rays = pixel_rays(rig.camera);
  EXPECT_GT(pose_information(clear, sigma, clear, sigma, rig.camera, rays, {})(5, 5), 0);
  EXPECT_EQ(pose_information(mixed, sigma, clear, sigma, rig.camera, rays, {}), Matrix6d::Zero());
  EXPECT_EQ(pose_information(clear, sigma, mixed, sigma, rig.camera, rays, {}), Matrix6d::Zero());
}

TEST(PoseInformation, GrowsWithTheInverseSquareOfSigma) {
  const RigModel rig = support::small_rig(false);
  const Matrix6d coarse = information_of(support::corner({0, 0, 1.1}), rig, {}, 2e-4),
                 fine = information_of(support::corner({0, 0, 1.1}), rig, {}, 1e-4);
  EXPECT_THAT((4 * coarse).eval(), MatrixNear(fine, 1e-6 * fine.cwiseAbs().maxCoeff()));
}

TEST(ErrorOverBound, IsOneAtTheBound) {
  const Pose truth = pose_from({{10, -5, 8}, {1, 1, 2}});
  const Matrix6d information = information_of(support::corner({0, 0, 1.1}), support::small_rig(false), truth, 1e-4);
  const Eigen::LLT<Matrix6d> factor(information);
  ASSERT_EQ(factor.info(), Eigen::Success);
  Random random(1);
  double squares = 0;
  std::vector<double> ratios;
  for (int i = 0; i < 4000; ++i) {
    const Vector6d error = factor.matrixU().solve(random.normals<6>());  // covariance J^-1
    ratios.push_back(error_over_bound(retract(truth, error), truth, information));
    squares += ratios.back() * ratios.back() / 4000;
  }
  EXPECT_NEAR(squares, 1, 0.05);
  EXPECT_NEAR(median_of(ratios), std::sqrt(5.348 / 6), 0.02);  // median of chi-square(6)
}

}  // namespace
}  // namespace fringeslam
