// SPDX-License-Identifier: Apache-2.0
#include "core/map/keyframe_map.h"

#include <gmock/gmock.h>

#include "core/map/map_cloud.h"
#include "core/types/linear_algebra.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::bumps;
using support::observe;
using support::PoseNear;
using support::Random;
using support::small_rig;

const RigModel kRig = small_rig(true);
const support::Surface kSurface = bumps(1, 0.03, 0.2);

Pose shifted(double x_m, double y_m = 0) { return {Eigen::Matrix3d::Identity(), {x_m, y_m, 0}}; }
Frame view(const Pose& world_from_camera) {
  Random noise(3);
  Frame frame = observe(kSurface, kRig, world_from_camera, 1e-4, &noise);
  frame.texture.create(frame.points_m.size());
  for (int i = 0; i < static_cast<int>(frame.texture.total()); ++i) frame.texture(i) = static_cast<uchar>(i % 251);
  return frame;
}

template <class Pixel>
bool same_bits(const cv::Mat_<Pixel>& a, const cv::Mat_<Pixel>& b) {
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a[row], b[row], sizeof(Pixel) * static_cast<size_t>(a.cols)) != 0) return false;
  }
  return a.size() == b.size();
}

TEST(StoredFrame, KeepsWhatRegistrationNeeds) {
  const PixelRays rays = pixel_rays(kRig.camera);
  const Frame frame = view({}), again = restored(stored(frame), rays);
  EXPECT_TRUE(same_bits(again.texture, frame.texture));
  int normals = 0;
  for (int i = 0; i < static_cast<int>(frame.points_m.total()); ++i) {
    ASSERT_EQ(std::isnan(again.points_m(i)[2]), std::isnan(frame.points_m(i)[2]));
    ASSERT_EQ(std::isnan(again.normals(i)[2]), std::isnan(frame.normals(i)[2]));
    if (std::isnan(frame.normals(i)[2])) continue;
    ++normals;
    ASSERT_EQ(again.points_m(i)[2], frame.points_m(i)[2]);
    ASSERT_LT(cv::norm(again.points_m(i) - frame.points_m(i)), 1e-6);
    ASSERT_NEAR(again.sigma_m(i) / frame.sigma_m(i), 1, 5e-4);
    ASSERT_LT(cv::norm(again.normals(i) - frame.normals(i)), 1e-4);
    ASSERT_NEAR(cv::norm(again.normals(i)), 1, 1e-6);
  }
  EXPECT_GT(normals, 1000);
}

// All directions, including those on the octahedron's folded half and on its edges.
TEST(StoredFrame, NormalsOfAllDirections) {
  Random random(1);
  Frame frame = view({});
  for (int i = 0; i < static_cast<int>(frame.normals.total()); ++i) {
    Eigen::Vector3d n = random.direction();
    if (i < 6) n = (i % 2 ? -1 : 1) * Eigen::Vector3d::Unit(i / 2);
    frame.normals(i) = {float(n.x()), float(n.y()), float(n.z())};
  }
  const Frame again = restored(stored(frame), pixel_rays(kRig.camera));
  for (int i = 0; i < static_cast<int>(frame.normals.total()); ++i)
    ASSERT_LT(cv::norm(again.normals(i) - frame.normals(i)), 1e-4) << frame.normals(i);
}

TEST(KeyframeMap, KeepsOnlyViewsThatDiffer) {
  KeyframeMap map(kRig, {});
  map.add_keyframe(view({}), {}, {});
  EXPECT_FALSE(map.add_frame(view({}), 0, {}));
  EXPECT_FALSE(map.add_frame(view(shifted(1e-3)), 0, shifted(1e-3)));
  EXPECT_TRUE(map.add_frame(view(shifted(0.05)), 0, shifted(0.05)));
  const size_t bytes = map.memory_bytes();
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(map.add_frame(view(shifted(0.05)), 0, shifted(0.05)));
  EXPECT_EQ(map.memory_bytes(), bytes);
  EXPECT_EQ(map.frames().size(), 2u);
}

TEST(KeyframeMap, OverlapIsTheShareThatBothSee) {
  const RigModel rig = small_rig(false);
  KeyframeMap map(rig, {});
  const support::Surface wall = support::plane({0, 0, 1}, 1.0);
  map.add_keyframe(observe(wall, rig, {}, 1e-4), {}, {});
  const double width_m = rig.camera.width / rig.camera.fx;
  for (const double share : {0.0, 0.25, 0.5, 1.0}) {
    const Pose pose = shifted(share * width_m);
    EXPECT_NEAR(map.expected_overlap(observe(wall, rig, pose, 1e-4), pose, 0), 1 - share, 0.08) << share;
  }
  // A surface at another depth is not the same surface.
  EXPECT_EQ(map.expected_overlap(observe(support::plane({0, 0, 1}, 1.2), rig, {}, 1e-4), {}, 0), 0);
}

// Frames move with their keyframe when a loop is closed.
TEST(KeyframeMap, CorrectionMovesKeyframesAndTheirFrames) {
  KeyframeMap map(kRig, {});
  map.add_keyframe(view({}), {}, {});
  map.add_keyframe(view(shifted(0.1)), {}, shifted(0.102));  // drifted by 2 mm
  map.add_frame(view(shifted(0.2)), 1, shifted(0.1));
  map.link({0, 1, shifted(0.102), 1e4 * Matrix6d::Identity(), false});
  map.link({0, 1, shifted(0.1), 1e10 * Matrix6d::Identity(), true});
  EXPECT_TRUE(map.correct({}, 1e-4));
  EXPECT_THAT(map.keyframes()[1].world_from_camera, PoseNear(shifted(0.1), 1e-6, 1e-6));
  EXPECT_THAT(map.keyframes()[0].world_from_camera, PoseNear(Pose{}, 1e-12, 1e-12));
  EXPECT_FALSE(map.correct({}, 1e-4)) << "already corrected";
  // After the correction the whole cloud lies on the surface, but for its noise of 0.1 mm. Where the surface is steep, points
  // that drifted by 2 mm lie almost 2 mm beside it.
  constexpr double kNear_m = 1e-3;
  const std::vector<CloudPoint> cloud = cloud_of(map, {});
  EXPECT_GT(cloud.size(), 10000u);
  for (const CloudPoint& point : cloud) {
    const Eigen::Vector3d p = point.position_m.cast<double>();
    const auto hit = kSurface(Eigen::Vector3d(p.x(), p.y(), 0), Eigen::Vector3d(0, 0, 1));
    ASSERT_TRUE(hit);
    ASSERT_LT(std::abs(hit->point.z() - p.z()), kNear_m);
  }
}

// The replaced frame shows the same surface elsewhere in its camera's axes; the rest of the map still shows it in the same place.
TEST(KeyframeMap, AReplacedFrameMovesTheRestOfTheMap) {
  KeyframeMap map(kRig, {});
  Landmarks landmarks;
  landmarks.keypoints.keypoints.resize(1);
  landmarks.keypoints.keypoints[0].point_m = {0.1, 0.2, 0.9};
  landmarks.keypoints.keypoints[0].covariance_m2 = Eigen::Vector3d(1, 2, 3).asDiagonal();
  map.add_keyframe(view({}), landmarks, {rotation_exp({0.2, 0.1, -0.3}), {0.3, 0.2, 0.1}});
  const Pose first_from_second = shifted(0.1);
  const Pose before = map.keyframes()[0].world_from_camera;
  map.add_keyframe(view(first_from_second), {}, before * first_from_second);
  map.add_frame(view(shifted(0.2)), 0, shifted(0.2));
  map.link({0, 1, first_from_second, Matrix6d::Identity(), false});
  map.link({1, 0, first_from_second.inverse(), Matrix6d::Identity(), true});
  const Pose new_from_old{rotation_exp({0.01, -0.02, 0.03}), {0.004, 0.005, -0.006}};
  map.replace_frame(0, view(new_from_old.inverse()), new_from_old);
  const Pose world_from_first = map.keyframes()[0].world_from_camera;
  EXPECT_THAT(world_from_first, PoseNear(before, 1e-15, 1e-15));
  const Pose second = world_from_first.inverse() * map.keyframes()[1].world_from_camera;
  EXPECT_THAT(second, PoseNear(new_from_old * first_from_second, 1e-12, 1e-12));
  EXPECT_THAT(map.frames()[2].keyframe_from_camera, PoseNear(new_from_old * shifted(0.2), 1e-12, 1e-12));
  EXPECT_THAT(map.links()[0].from_from_to, PoseNear(second, 1e-12, 1e-12));
  EXPECT_THAT(map.links()[1].from_from_to, PoseNear(second.inverse(), 1e-12, 1e-12));
  const Keypoint moved = map.keyframes()[0].landmarks.get()->keypoints.keypoints[0];
  EXPECT_LT((moved.point_m - new_from_old * Eigen::Vector3d(0.1, 0.2, 0.9)).norm(), 1e-15);
  EXPECT_NEAR((new_from_old.rotation.transpose() * moved.covariance_m2 * new_from_old.rotation)(2, 2), 3, 1e-12);
}

// Links of a nearly bare plane: the inverse of the inverse of their information is not symmetric to the last digits.
TEST(KeyframeMap, LinksOfAPlaneCanBeCorrected) {
  Random random(3);
  double most = 0;
  for (int n = 0; n < 40; ++n) {
    // 200,000 points of a tilted plane with a sigma of 20 um, and 1 mm along it.
    const Eigen::Vector3d normal = rotation_exp(0.4 * random.direction()) * Eigen::Vector3d(0.3, 0.2, -1).normalized();
    Matrix6d information = Matrix6d::Zero();
    for (int i = 0; i < 400; ++i) {
      const Eigen::Vector3d point = Eigen::Vector3d(0, 0, 1) + 0.3 * random.direction();
      Vector6d row;
      row << point.cross(normal), normal;
      information += 500 / (2e-5 * 2e-5) * row * row.transpose();
    }
    information.diagonal().tail<3>().array() += 1e6;
    information.diagonal().head<3>().array() += 1e6;
    const Matrix6d covariance = inverse(information), again = inverse(Matrix6d(1.25 * covariance));
    most = std::max(most, (again - again.transpose()).cwiseAbs().maxCoeff() / again.cwiseAbs().maxCoeff());
    KeyframeMap map(kRig, {});
    for (int k = 0; k < 3; ++k) map.add_keyframe(view({}), {}, shifted(0.1 * k));
    for (int k = 0; k < 2; ++k) map.link({k, k + 1, shifted(0.1), again, false});
    map.link({0, 2, shifted(0.2), again, true});
    EXPECT_NO_THROW(map.correct({}, 1e-6));
  }
  EXPECT_GT(most, 1e-9);  // which the pose graph would refuse
}

TEST(KeyframeMap, CountsLinksBetweenKeyframes) {
  KeyframeMap map(kRig, {});
  for (int i = 0; i < 6; ++i) map.add_keyframe(view({}), {}, {});
  for (int i = 0; i < 4; ++i) map.link({i, i + 1, {}, Matrix6d::Identity(), false});
  EXPECT_TRUE(map.linked_within(2, 2, 0));
  EXPECT_TRUE(map.linked_within(0, 3, 3));
  EXPECT_TRUE(map.linked_within(4, 1, 3));
  EXPECT_FALSE(map.linked_within(0, 4, 3));
  EXPECT_FALSE(map.linked_within(0, 5, 100));
  map.link({4, 0, {}, Matrix6d::Identity(), true});
  EXPECT_TRUE(map.linked_within(0, 3, 2));
}

// Otherwise a place that looks the same, once rejected, would no longer be tested when the robot seems to be there again.
TEST(KeyframeMap, ALoopThatDisagreesJoinsNothing) {
  KeyframeMap map(kRig, {});
  for (int i = 0; i < 6; ++i) map.add_keyframe(view({}), {}, shifted(0.1 * i));
  const Matrix6d information = 1e6 * Matrix6d::Identity();
  for (int i = 0; i < 5; ++i) map.link({i, i + 1, shifted(0.1), information, false});
  map.link({5, 0, {}, information, true});
  map.correct({}, 1e-3);
  EXPECT_FALSE(map.linked_within(0, 5, 3));
  map.link({5, 0, shifted(-0.5), information, true});
  EXPECT_TRUE(map.linked_within(0, 5, 3));
}

}  // namespace
}  // namespace fringeslam
