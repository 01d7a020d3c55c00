// SPDX-License-Identifier: Apache-2.0
#include "core/registration/icp.h"

#include <gmock/gmock.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <limits>
#include <opencv2/core/utility.hpp>

#include "core/depth/depth.h"
#include "core/score/score.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::bumps;
using support::corner;
using support::MatrixNear;
using support::observe;
using support::plane;
using support::PoseNear;
using support::Random;
using support::small_rig;
using support::Surface;

constexpr double kRadPerDeg = 0.017453292519943295;
const Pose kTruth = pose_from({{20, -12, 15}, {1, -1.5, 3}});  // target_from_source

// Start pose: the ground truth displaced by `metres` and rotated by `degrees` about a point 1 m in front of the
// camera.
Pose disturbed(const Pose& truth, double metres, double degrees, Random& random) {
  const Pose to_scene{Eigen::Matrix3d::Identity(), {0, 0, 1}};
  const Pose offset{rotation_exp(degrees * kRadPerDeg * random.direction()), metres * random.direction()};
  return truth * to_scene * offset * to_scene.inverse();
}

TEST(Icp, PlanesOfACornerAreExact) {
  const RigModel rig = small_rig(false);
  const Surface surface = corner({0.01, -0.01, 1.1});
  const Frame target = observe(surface, rig, {}, 2e-5), source = observe(surface, rig, kTruth, 2e-5);
  Random random(1);
  for (int start = 0; start < 20; ++start) {
    const Pose initial = disturbed(kTruth, 0.01, 2, random);
    const IcpResult result = point_to_plane_icp(target, source, rig.camera, initial, {});
    EXPECT_TRUE(result.converged) << "start " << start;
    EXPECT_THAT(result.target_from_source, PoseNear(kTruth, 1e-6, 1e-6)) << "start " << start;
    EXPECT_GT(result.overlap, 0.5);
    EXPECT_GE(result.pairs, 6);
  }
}

TEST(Icp, DistortedLensIsNoMatter) {
  const RigModel rig = small_rig(true);
  const Surface surface = corner({0.01, -0.01, 1.1});
  Random random(2);
  const IcpResult result = point_to_plane_icp(observe(surface, rig, {}, 2e-5), observe(surface, rig, kTruth, 2e-5),
                                              rig.camera, disturbed(kTruth, 0.01, 2, random), {});
  EXPECT_TRUE(result.converged);
  EXPECT_THAT(result.target_from_source, PoseNear(kTruth, 1e-6, 1e-6));
}

TEST(Icp, CurvedSurfacesConvergeToWithinAPixelsCurvature) {
  const RigModel rig = small_rig(false);
  const Surface surface = bumps(1, 0.01, 0.15);
  const Frame target = observe(surface, rig, {}, 2e-5), source = observe(surface, rig, kTruth, 2e-5);
  Random random(3);
  for (int start = 0; start < 20; ++start) {
    const Pose initial = disturbed(kTruth, 0.01, 2, random);
    const IcpResult result = point_to_plane_icp(target, source, rig.camera, initial, {});
    EXPECT_TRUE(result.converged) << "start " << start;
    // Correspondences are up to 1.4 mm apart; with a curvature of 0.01 (2 pi / 0.15)^2 = 17.5 / m that is up to 17 um
    // from the correspondence's plane. The mean of both planes leaves only the change of curvature in between.
    EXPECT_THAT(result.target_from_source, PoseNear(kTruth, 3e-6, 3e-6)) << "start " << start;
  }
}

TEST(Icp, IdenticalFramesStayWhereTheyAre) {
  const RigModel rig = small_rig(false);
  const Frame frame = observe(bumps(1, 0.01, 0.15), rig, {}, 2e-5);
  const IcpResult result = point_to_plane_icp(frame, frame, rig.camera, {}, {});
  EXPECT_TRUE(result.converged);
  EXPECT_THAT(result.target_from_source, PoseNear(Pose{}, 1e-12, 1e-12));
  EXPECT_EQ(result.overlap, 1);
  EXPECT_NEAR(result.rms_m, 0, 1e-12);
}

// Held 2 mm off by a prior, with gates too narrow to pull it back.
TEST(Icp, AViewThatConvergedBesideItsPlaceMovesWhenPartnersCountAgain) {
  const RigModel rig = small_rig(false);
  const Frame frame = observe(bumps(1.0, 0.003, 0.2), rig, {}, 2e-5);
  IcpOptions options;
  options.max_distance_m = 1e-4;
  options.min_overlap = 0;
  options.max_rms_sigma = 1000;
  const IcpResult slid = point_to_plane_icp(frame, frame, rig.camera, {Eigen::Matrix3d::Identity(), {2e-3, 0, 0}},
                                            options, 1e10 * Matrix6d::Identity());
  const IcpResult right = point_to_plane_icp(frame, frame, rig.camera, {}, options);
  ASSERT_TRUE(slid.converged && right.converged);
  EXPECT_GT(slid.reopened_sigma, 20);
  EXPECT_LT(right.reopened_sigma, 1);
}

TEST(Icp, InformationIsHonestAndSigmasAreRight) {
  constexpr int kDraws = 200;
  const RigModel rig = small_rig(false);
  const Surface surface = corner({0.01, -0.01, 1.1});
  Random random(4);
  double nees = 0, rms = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const Frame target = observe(surface, rig, {}, 1e-4, &random),
                source = observe(surface, rig, kTruth, 1e-4, &random);
    const IcpResult result = point_to_plane_icp(target, source, rig.camera, disturbed(kTruth, 1e-3, 0.1, random), {});
    ASSERT_TRUE(result.converged);
    const Vector6d error = difference(result.target_from_source, kTruth);
    EXPECT_LT(result.reopened_sigma, 5);
    nees += error.dot(result.information * error) / kDraws;
    rms += result.rms_sigma / kDraws;
  }
  EXPECT_NEAR(nees, 6, 1.96 * std::sqrt(12.0 / kDraws));
  EXPECT_NEAR(rms, 1, 0.02);
}

TEST(Icp, InformationIsThatOfTheBound) {
  // Compares with an independent computation of the bound (docs/method.md, section 7.2), for a large motion.
  const RigModel rig = small_rig(false);
  const Surface surface = corner({0.01, -0.01, 1.1});
  const Pose motion = pose_from({{60, -40, 120}, {2, -3, 40}});
  const IcpResult result =
      point_to_plane_icp(observe(surface, rig, {}, 1e-4), observe(surface, rig, motion, 1e-4), rig.camera, motion, {});
  ASSERT_TRUE(result.converged);
  const cv::Mat1f sigma(rig.camera.height, rig.camera.width, 1e-4F);
  const Matrix6d bound = pose_information(truth_of(surface, rig, {}), sigma, truth_of(surface, rig, motion), sigma,
                                          rig.camera, pixel_rays(rig.camera), motion);
  EXPECT_THAT(result.information, MatrixNear(bound, 0.01 * bound.cwiseAbs().maxCoeff()));
}

// True if the result reports that the pose is unknown: no convergence, or a direction without information.
bool says_unknown(const IcpResult& result, double sigma_m) {
  if (!result.converged) return true;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(result.information);
  return eigen.eigenvalues().minCoeff() < 1 / (sigma_m * sigma_m);
}

TEST(Icp, ABarePlaneHoldsNothingSideways) {
  const RigModel rig = small_rig(false);
  const Surface wall = plane(Eigen::Vector3d(0.2, 0.1, -1).normalized(), -1);
  const Pose start = kTruth * Pose{Eigen::Matrix3d::Identity(), {0.005, 0, 0}};
  const IcpResult result =
      point_to_plane_icp(observe(wall, rig, {}, 2e-5), observe(wall, rig, kTruth, 2e-5), rig.camera, start, {});
  EXPECT_TRUE(says_unknown(result, 0.005));
}

TEST(Icp, ABarePlaneWithNoisyNormalsHoldsNothingSidewaysEither) {
  // Noise of the measured normals looks like information although all pairs lie on one plane.
  const RigModel rig = small_rig(false);
  const Surface wall = plane(Eigen::Vector3d(0.2, 0.1, -1).normalized(), -1);
  const PixelRays rays = pixel_rays(rig.camera);
  const Pose start = kTruth * Pose{Eigen::Matrix3d::Identity(), {0.005, 0, 0}};
  for (const double sigma_px : {0.03, 0.1, 0.2}) {
    Random random(5);
    for (int draw = 0; draw < 5; ++draw) {
      const Frame target = reconstruct(seen_columns(wall, rig, {}, sigma_px, &random), rig, rays, {});
      const Frame source = reconstruct(seen_columns(wall, rig, kTruth, sigma_px, &random), rig, rays, {});
      const IcpResult result = point_to_plane_icp(target, source, rig.camera, start, {});
      EXPECT_TRUE(says_unknown(result, 0.005))
          << "converged " << 1e3 * (result.target_from_source.translation - kTruth.translation).norm()
          << " mm off with translation sigmas of "
          << 1e3 * result.information.inverse().diagonal().tail<3>().cwiseSqrt().transpose() << " mm";
    }
  }
}

TEST(Icp, NoisyNormalsLeaveThePriorItsSay) {
  // On a bare plane, the error sideways and about the normal is that of the prior, and so must be its information.
  constexpr int kDraws = 60;
  const RigModel rig = small_rig(false);
  const Surface wall = plane(Eigen::Vector3d(0.2, 0.1, -1).normalized(), -1);
  const PixelRays rays = pixel_rays(rig.camera);
  Random random(6);
  double nees = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    Vector6d sigmas, offset;
    sigmas << Eigen::Vector3d::Constant(2e-3), Eigen::Vector3d::Constant(2e-3);
    for (int i = 0; i < 6; ++i) offset[i] = sigmas[i] * random.normal();
    const Matrix6d prior = sigmas.cwiseAbs2().cwiseInverse().asDiagonal();
    const Frame target = reconstruct(seen_columns(wall, rig, {}, 0.1, &random), rig, rays, {});
    const Frame source = reconstruct(seen_columns(wall, rig, kTruth, 0.1, &random), rig, rays, {});
    const IcpResult result = point_to_plane_icp(target, source, rig.camera, retract(kTruth, offset), {}, prior);
    const Vector6d error = difference(result.target_from_source, kTruth);
    nees += error.dot(result.information * error) / kDraws;
  }
  EXPECT_NEAR(nees, 6, 1.96 * std::sqrt(12.0 / kDraws));
}

TEST(Icp, APriorDecidesWhatABarePlaneLeavesOpen) {
  // The plane corrects the distance along its normal; sideways, the prior's pose is kept.
  const RigModel rig = small_rig(false);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, 0.1, -1).normalized();
  const Surface wall = plane(normal, -1);
  const Eigen::Vector3d sideways = 2e-3 * normal.cross(Eigen::Vector3d::UnitY()).normalized();
  Pose start = kTruth;
  start.translation += sideways + 1e-3 * normal;
  const Matrix6d prior = Matrix6d::Identity() * 1e4;  // 10 mrad, 10 mm
  const IcpResult result =
      point_to_plane_icp(observe(wall, rig, {}, 2e-5), observe(wall, rig, kTruth, 2e-5), rig.camera, start, {}, prior);
  EXPECT_TRUE(result.converged);
  EXPECT_LT((result.target_from_source.translation - kTruth.translation - sideways).norm(), 2e-5);
  EXPECT_LT(rotation_rad(result.target_from_source * kTruth.inverse()), 2e-5);
  const Eigen::Vector3d sigmas = result.information.inverse().diagonal().tail<3>().cwiseSqrt();
  EXPECT_LT(sigmas.maxCoeff(), 1.01e-2);
}

TEST(Icp, APriorIsInTheInformationBeforeTheFitHasSettled) {
  const RigModel rig = small_rig(false);
  const Surface wall = plane(Eigen::Vector3d(0.2, 0.1, -1).normalized(), -1);
  const Matrix6d prior = Matrix6d::Identity() * 1e4;
  IcpOptions options;
  options.max_iterations = 1;
  const IcpResult result = point_to_plane_icp(observe(wall, rig, {}, 2e-5), observe(wall, rig, kTruth, 2e-5),
                                              rig.camera, kTruth, options, prior);
  EXPECT_FALSE(result.converged);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(result.information);
  EXPECT_GT(eigen.eigenvalues().minCoeff(), 0.99e4);
}

TEST(Icp, FramesWithoutDepthDoNotConverge) {
  const RigModel rig = small_rig(false);
  const Frame good = observe(corner({0, 0, 1.1}), rig, {}, 2e-5);
  const Frame nothing = observe(plane({0, 0, 1}, -1), rig, {}, 2e-5);  // behind the camera
  for (const auto& [target, source] : {std::pair(good, nothing), {nothing, good}, {nothing, nothing}}) {
    const IcpResult result = point_to_plane_icp(target, source, rig.camera, kTruth, {});
    EXPECT_FALSE(result.converged);
    EXPECT_TRUE(result.target_from_source.is_finite());
  }
}

TEST(Icp, FramesThatDoNotOverlapDoNotConverge) {
  const RigModel rig = small_rig(false);
  const Frame frame = observe(corner({0, 0, 1.1}), rig, {}, 2e-5);
  EXPECT_FALSE(point_to_plane_icp(frame, frame, rig.camera, pose_from({{5000, 0, 0}, {0, 0, 0}}), {}).converged);
  // A different scene: the few pairs that fit do not make a fit.
  const Frame other = observe(bumps(1, 0.03, 0.08), rig, {}, 2e-5);
  EXPECT_FALSE(point_to_plane_icp(frame, other, rig.camera, {}, {}).converged);
}

TEST(Icp, ResultDoesNotDependOnTheNumberOfThreads) {
  const RigModel rig = small_rig(false);
  Random random(6);
  const Surface surface = bumps(1, 0.01, 0.15);
  const Frame target = observe(surface, rig, {}, 1e-4, &random), source = observe(surface, rig, kTruth, 1e-4, &random);
  const Pose start = disturbed(kTruth, 0.005, 1, random);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const IcpResult one = point_to_plane_icp(target, source, rig.camera, start, {});
  cv::setNumThreads(2);
  const IcpResult two = point_to_plane_icp(target, source, rig.camera, start, {});
  cv::setNumThreads(threads);
  EXPECT_EQ(one.target_from_source.rotation, two.target_from_source.rotation);
  EXPECT_EQ(one.target_from_source.translation, two.target_from_source.translation);
  EXPECT_EQ(one.information, two.information);
  EXPECT_EQ(one.iterations, two.iterations);
  EXPECT_EQ(one.rms_sigma, two.rms_sigma);
}

}  // namespace
}  // namespace fringeslam
