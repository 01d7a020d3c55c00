// SPDX-License-Identifier: Apache-2.0
#include "core/registration/reference/engines.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <limits>

#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::bumps;
using support::corner;
using support::observe;
using support::PoseNear;
using support::Random;
using support::small_rig;
using support::Surface;

class Engines : public testing::TestWithParam<RegistrationEngine> {};

TEST_P(Engines, PointsMovedByLessThanTheirSpacingComeBack) {
  if (GetParam() == RegistrationEngine::point_to_plane || GetParam() == RegistrationEngine::pcl_gicp)
    GTEST_SKIP() << "pairs planes, not points";
  const RigModel rig = small_rig(false);
  const Pose truth = pose_from({{0.2, -0.15, 0.1}, {0.01, -0.02, 0.015}});
  const Frame source = observe(bumps(1, 0.01, 0.15), rig, {}, 2e-5);
  Frame target = source;
  target.points_m = source.points_m.clone();
  for (cv::Vec3f& p : target.points_m) {
    const Eigen::Vector3d moved = truth * Eigen::Vector3d(p[0], p[1], p[2]);
    p = cv::Vec3f(static_cast<float>(moved.x()), static_cast<float>(moved.y()), static_cast<float>(moved.z()));
  }
  IcpOptions options;
  options.max_distance_m = 0.02;
  options.max_iterations = 200;
  const IcpResult result = register_with_engine(GetParam(), target, source, rig.camera, {}, options, 1);
  EXPECT_THAT(result.target_from_source, PoseNear(truth, 2e-6, 2e-6));
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.overlap, 0.99);
  EXPECT_GT(result.information(2, 2), 0);
}

TEST_P(Engines, PlanesOfACornerComeTogether) {
  if (GetParam() != RegistrationEngine::point_to_plane && GetParam() != RegistrationEngine::pcl_gicp)
    GTEST_SKIP() << "pairs points, not planes";
  const RigModel rig = small_rig(false);
  const Surface surface = corner({0.01, -0.01, 1.1});
  const Pose truth = pose_from({{6, -4, 5}, {0.6, -0.4, 0.5}});
  IcpOptions options;
  options.max_distance_m = 0.02;
  options.max_iterations = 200;
  const IcpResult result = register_with_engine(GetParam(), observe(surface, rig, {}, 2e-5),
                                                observe(surface, rig, truth, 2e-5), rig.camera, {}, options, 1);
  // GICP's covariances round off the corner for sparse points.
  const double limit = GetParam() == RegistrationEngine::pcl_gicp ? 3e-3 : 1e-6;
  EXPECT_THAT(result.target_from_source, PoseNear(truth, limit, limit));
  EXPECT_TRUE(result.converged);
}

TEST_P(Engines, NothingToRegisterIsNotConverged) {
  const RigModel rig = small_rig(false);
  const Frame frame = observe(bumps(1, 0.01, 0.15), rig, {}, 2e-5);
  Frame empty = frame;
  empty.points_m = frame.points_m.clone();
  empty.normals = frame.normals.clone();
  empty.sigma_m = frame.sigma_m.clone();
  empty.points_m.setTo(cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  empty.normals.setTo(cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  empty.sigma_m.setTo(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(register_with_engine(GetParam(), frame, empty, rig.camera, {}, {}).converged);
  EXPECT_FALSE(register_with_engine(GetParam(), empty, frame, rig.camera, {}, {}).converged);
  EXPECT_FALSE(register_with_engine(GetParam(), empty, empty, rig.camera, {}, {}).converged);
  EXPECT_FALSE(register_frames(empty, frame, rig.camera, {}).converged);
}

INSTANTIATE_TEST_SUITE_P(All, Engines, testing::ValuesIn(registration_engines()),
                         [](const auto& test) { return std::string(to_string(test.param)); });

TEST(ColdRegistration, FindsTurnsToAllSides) {
  const RigModel rig = small_rig(false);
  const Surface surface = corner({0.01, -0.01, 1.1});
  const Pose to_middle{Eigen::Matrix3d::Identity(), {0, 0, 1.1}};
  Random random(5);
  for (int i = 0; i < 6; ++i) {
    const Pose motion{rotation_exp(0.17 * random.direction()), 0.03 * random.direction()};
    const Pose truth = to_middle * motion * to_middle.inverse();
    const IcpResult result =
        register_frames(observe(surface, rig, {}, 2e-5), observe(surface, rig, truth, 2e-5), rig.camera, {});
    EXPECT_TRUE(result.converged) << i;
    EXPECT_THAT(result.target_from_source, PoseNear(truth, 1e-6, 1e-6)) << i;
  }
}

}  // namespace
}  // namespace fringeslam
