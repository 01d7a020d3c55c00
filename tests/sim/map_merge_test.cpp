// SPDX-License-Identifier: Apache-2.0
// Maps of two missions through the same, another or a repetitive place.
#include "core/mapper/map_merge.h"

#include <gmock/gmock.h>

#include <cmath>

#include "core/mapper/pipeline.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Scene terrain() { return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml"); }

// Cameras 1 m above the ground that look down.
Pose camera_above(double x_m, double y_m, double turn_deg) {
  return {rotation_exp({0, 0, turn_deg * kPi / 180}) * rotation_exp({kPi, 0, 0}), {x_m, y_m, 1}};
}

PipelineOptions options() {
  PipelineOptions options;
  options.mapping.every_view = true;
  return options;
}

struct Mission {
  std::vector<Pose> world_from_camera;  // true
  KeyframeMap map;
};

// Maps the views; the world of the map is the robot's frame at the first one.
Mission mission(Scene scene, const std::vector<Pose>& world_from_camera) {
  scene.trajectory.clear();
  for (const Pose& pose : world_from_camera)
    scene.trajectory.push_back(
        {0.5 * static_cast<double>(scene.trajectory.size()), pose * scene.rig.robot_from_camera.inverse()});
  VirtualRig rig(scene, {});
  Pipeline pipeline(scene.rig, scene.patterns, options(), {});
  while (const auto stack = rig.capture(scene.patterns)) EXPECT_TRUE(has_pose(pipeline.process(*stack).tracking));
  EXPECT_EQ(pipeline.map().keyframes().size(), world_from_camera.size());
  return {world_from_camera, pipeline.map()};
}

MergedMap merged(const Mission& a, const Mission& b) { return merge_maps(a.map, b.map, options().mapper(), "B"); }

TEST(MapMerge, PlacesAMissionThatReturnsFromElsewhere) {
  const Scene scene = terrain();
  const Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.15, 0, 5), camera_above(0.3, 0.05, 5)});
  const Mission b = mission(scene, {camera_above(0.75, 0.3, 60), camera_above(0.55, 0.15, 55),
                                    camera_above(0.35, 0.1, 50), camera_above(0.2, -0.05, 45)});
  const MergedMap both = merged(a, b);
  ASSERT_EQ(both.map.keyframes().size(), 7u);
  EXPECT_EQ(both.map.frames().size(), a.map.frames().size() + b.map.frames().size());
  EXPECT_EQ(both.contradicting, 0);

  const Pose camera_from_robot = scene.rig.robot_from_camera.inverse();
  const Pose truth =
      (a.world_from_camera[0] * camera_from_robot).inverse() * b.world_from_camera[0] * camera_from_robot;
  const Vector6d error = difference(both.a_from_b, truth);
  EXPECT_LT(error.tail<3>().norm(), 0.2e-3);
  EXPECT_LT(error.head<3>().norm(), 0.02 * kPi / 180);
  EXPECT_LT(error.dot(solve_symmetric(both.covariance, error)), 28);  // 6 degrees of freedom, once in 10,000
  // All keyframes are in the world of A.
  for (size_t i = 0; i < 7; ++i) {
    const Pose& camera = i < 3 ? a.world_from_camera[i] : b.world_from_camera[i - 3];
    const Pose relative = (a.world_from_camera[0] * camera_from_robot).inverse() * camera;
    EXPECT_LT(difference(both.map.keyframes()[i].world_from_camera, relative).tail<3>().norm(), 0.2e-3) << i;
  }
}

TEST(MapMerge, TheMergedMapLocatesViewsOfBothMissions) {
  Scene scene = terrain();
  const Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.2, 0, 0), camera_above(0.4, 0, 0)});
  const Mission b = mission(scene, {camera_above(0.3, 0.05, 20), camera_above(0.5, 0.1, 20),
                                    camera_above(0.75, 0.1, 20), camera_above(1, 0.1, 20)});
  const MergedMap both = merged(a, b);
  const Pose a_from_world = (a.world_from_camera[0] * scene.rig.robot_from_camera.inverse()).inverse();
  for (const Pose& camera : {camera_above(-0.05, 0.02, 10), camera_above(1.05, 0.12, -10)}) {
    Pipeline pipeline(both.map, scene.patterns, options());
    scene.trajectory = {{0, camera * scene.rig.robot_from_camera.inverse()}};
    VirtualRig rig(scene, {});
    const FrameResult found = pipeline.process(*rig.capture(scene.patterns));
    ASSERT_EQ(found.tracking, Tracking::refined);
    const Pose truth = a_from_world * scene.trajectory.front().world_from_robot;
    EXPECT_LT(difference(found.world_from_robot, truth).tail<3>().norm(), 0.3e-3);
  }
}

// The motions of keyframes during their stacks are uncertain in the other map too.
TEST(MapMerge, UncertainMotionsOfKeyframesWidenTheLinks) {
  constexpr double kVariance_m2 = 1e-6;
  const Scene scene = terrain();
  Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.15, 0, 5)});
  Mission b = mission(scene, {camera_above(0.05, 0.05, 60), camera_above(0.2, 0.02, 55)});
  const MergedMap still = merged(a, b);
  KeyframeMotion shifted;
  shifted.covariance.diagonal().tail<3>().setConstant(kVariance_m2);
  for (KeyframeMap* const map : {&a.map, &b.map}) {
    for (int i = 0; i < 2; ++i) map->set_motion(i, shifted);
  }
  const MergedMap moved = merged(a, b);
  int compared = 0;
  for (const CrossLink& link : moved.links) {
    for (const CrossLink& other : still.links) {
      if (link.a != other.a || link.b != other.b || !link.by_landmarks || !other.by_landmarks) continue;
      const Vector6d added = (link.covariance - other.covariance).diagonal();
      EXPECT_GE(added.tail<3>().minCoeff(), 2 * kLinkVariance * kVariance_m2 * (1 - 1e-9));
      ++compared;
    }
  }
  EXPECT_GE(compared, 2);
  EXPECT_GT(moved.covariance.diagonal().tail<3>().minCoeff(), kVariance_m2);
  EXPECT_EQ(moved.map.keyframes()[3].motion.covariance, shifted.covariance);
}

// A view of a later run is registered with a keyframe that lies elsewhere by an unknown shift and turn.
TEST(OpenedMap, TheMotionOfAKeyframeWidensThePosesRelativeToIt) {
  constexpr double kShiftVariance_m2 = 1e-6, kTurnVariance_rad2 = 1e-6;
  Scene scene = terrain();
  Mission one = mission(scene, {camera_above(0, 0, 0)});
  scene.trajectory = {{0, camera_above(0.1, 0.05, 5) * scene.rig.robot_from_camera.inverse()}};
  const auto located = [&] {
    Pipeline pipeline(one.map, scene.patterns, options());
    VirtualRig rig(scene, {});
    return pipeline.process(*rig.capture(scene.patterns));
  };
  const FrameResult still = located();
  ASSERT_EQ(still.tracking, Tracking::refined);
  KeyframeMotion moved;
  moved.covariance.diagonal().head<3>().setConstant(kTurnVariance_rad2);
  moved.covariance.diagonal().tail<3>().setConstant(kShiftVariance_m2);
  one.map.set_motion(0, moved);
  const FrameResult shifted = located();
  ASSERT_EQ(shifted.tracking, Tracking::refined);
  const Vector6d added = (shifted.covariance - still.covariance).diagonal();
  const Eigen::Vector3d lever = skew(still.registration.earlier_from_current.translation).rowwise().squaredNorm();
  EXPECT_GT(lever.maxCoeff(), 0.01);
  for (int i = 0; i < 3; ++i) {
    EXPECT_GE(added[i], kTurnVariance_rad2 * (1 - 1e-9));
    EXPECT_GE(added[3 + i], (kShiftVariance_m2 + lever[i] * kTurnVariance_rad2) * (1 - 1e-9));
  }
}

std::string refusal(const Mission& a, const Mission& b) {
  try {
    merged(a, b);
  } catch (const Error& e) {
    return e.what();
  }
  return "merged";
}

TEST(MapMerge, RefusesMapsOfDifferentPlaces) {
  const Scene scene = terrain();
  const Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.2, 0, 0)});
  const Mission b = mission(scene, {camera_above(-1.6, 0.9, 0), camera_above(-1.4, 0.9, 0)});
  EXPECT_THAT(refusal(a, b), AllOf(HasSubstr("B: "), HasSubstr("0 of 2 keyframes are re-identified")));
}

TEST(MapMerge, RefusesEvidenceOfASingleView) {
  const Scene scene = terrain();
  const Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.2, 0, 0)});
  const Mission b = mission(scene, {camera_above(0.1, 0.1, 30)});
  EXPECT_THAT(refusal(a, b), HasSubstr("1 of 1 keyframes are re-identified"));
}

// Equal blocks with equal grain in a square grid, and a stone, by which views of the same mission are registered.
Scene blocks_with_stone(int seed, double x_m, double y_m) {
  constexpr double kPeriod_m = 0.05;
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/boxes_and_foam/scene.yaml");
  scene.objects.clear();
  scene.objects.push_back(grey_object(plane_mesh(3, 3), {}, 0.4));
  for (int i = -14; i <= 14; ++i) {
    for (int j = -14; j <= 14; ++j) {
      Object block = grey_object(box_mesh({0.03, 0.025, 0.02}),
                                 {Eigen::Matrix3d::Identity(), {i * kPeriod_m, j * kPeriod_m, 0.01}});
      block.material.grain = Grain::stone;
      block.material.contrast = 0.4;
      block.material.grain_m = 0.008;
      block.texture_seed = 1;
      scene.objects.push_back(std::move(block));
    }
  }
  scene.objects.push_back(
      grey_object(rock_mesh({0.11, 0.1, 0.08}, seed, 0.25, 3), {Eigen::Matrix3d::Identity(), {x_m, y_m, 0.03}}, 0.6));
  return scene;
}

TEST(MapMerge, RefusesPlacesThatOnlyLookAlike) {
  const std::vector<Pose> path = {camera_above(0, 0, 0), camera_above(0.03, 0.02, 3), camera_above(0.06, 0.01, 5)};
  const Mission a = mission(blocks_with_stone(3, 0.01, 0.005), path);
  const Mission b = mission(blocks_with_stone(8, -0.06, 0.04), path);
  EXPECT_THAT(refusal(a, b), HasSubstr("B: "));
}

TEST(MapMerge, AStoneAmongEqualBlocksIsEvidence) {
  const Scene scene = blocks_with_stone(3, 0.01, 0.005);
  const Mission a = mission(scene, {camera_above(0, 0, 0), camera_above(0.03, 0.02, 3), camera_above(0.06, 0.01, 5)});
  const Mission b = mission(scene, {camera_above(0.08, 0.03, 20), camera_above(0.05, 0.03, 17)});
  const MergedMap both = merged(a, b);
  const Pose camera_from_robot = scene.rig.robot_from_camera.inverse();
  const Pose truth =
      (a.world_from_camera[0] * camera_from_robot).inverse() * b.world_from_camera[0] * camera_from_robot;
  EXPECT_LT(difference(both.a_from_b, truth).tail<3>().norm(), 0.2e-3);
}

}  // namespace
}  // namespace fringeslam::sim
