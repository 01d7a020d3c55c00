// SPDX-License-Identifier: Apache-2.0
// Views of repetitive structure: a pose is ambiguous if others fit equally well, and rejected if depth contradicts it.
#include "core/registration/ambiguity.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

constexpr double kPeriod_m = 0.05;

Scene boxes() { return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/boxes_and_foam/scene.yaml"); }

// Equal blocks on a floor, all in a square grid.
Scene blocks(bool with_landmark) {
  Scene scene = boxes();
  scene.objects.clear();
  scene.objects.push_back(grey_object(plane_mesh(1.2, 1.2), {}, 0.4));
  for (int i = -6; i <= 6; ++i) {
    for (int j = -6; j <= 6; ++j) {
      Pose place;
      place.translation = {i * kPeriod_m, j * kPeriod_m, 0.01};
      scene.objects.push_back(grey_object(box_mesh({0.03, 0.025, 0.02}), place));
    }
  }
  if (with_landmark) {
    Pose place;
    place.translation = {0.01, 0.005, 0.03};
    scene.objects.push_back(grey_object(rock_mesh({0.11, 0.1, 0.08}, 3, 0.25, 3), place, 0.6));
  }
  return scene;
}

// Cameras 1 m above the floor.
Pose camera_above(double x_m, double y_m, double turn_deg) {
  Pose pose;
  pose.rotation = rotation_exp({0, 0, turn_deg * kPi / 180}) * rotation_exp({kPi, 0, 0});
  pose.translation = {x_m, y_m, 1};
  return pose;
}

void set_cameras(Scene& scene, const std::vector<Pose>& world_from_camera) {
  scene.trajectory.clear();
  for (const Pose& pose : world_from_camera)
    scene.trajectory.push_back(
        {static_cast<double>(scene.trajectory.size()), pose * scene.rig.robot_from_camera.inverse()});
}

struct TwoViews {
  Scene scene;
  Frame target, source;
  Pose truth;

  TwoViews(Scene s, const Pose& first, const Pose& second) : scene(std::move(s)), truth(first.inverse() * second) {
    set_cameras(scene, {first, second});
    VirtualRig rig(scene, {});
    for (Frame* frame : {&target, &source}) {
      const FringeStack stack = *rig.capture(scene.patterns);
      *frame = reconstruct(decode(stack, scene.rig, {}), scene.rig, pixel_rays(scene.rig.camera), {});
    }
  }
  AmbiguityReport report(const Admissible& admissible = {}) const {
    return find_alternatives(target, source, scene.rig.camera, truth, {}, admissible);
  }
};

TEST(Ambiguity, AlternativesOfAGridAreWholePeriodsAway) {
  const Pose first = camera_above(0, 0, 0);
  const TwoViews views(blocks(false), first, camera_above(0.02, 0.015, 4));
  const AmbiguityReport report = views.report();
  EXPECT_FALSE(report.contradicted);
  ASSERT_FALSE(report.alternatives.empty());
  bool one_period = false;
  for (const AlternativePose& alternative : report.alternatives) {
    // The motion of the world that leads from one pose to the other is a symmetry of the grid.
    const Pose symmetry = first * alternative.target_from_source * views.truth.inverse() * first.inverse();
    const double quarter_turns = rotation_log(symmetry.rotation).norm() / (0.5 * kPi);
    EXPECT_NEAR(quarter_turns, std::round(quarter_turns), 0.01);
    for (const double periods : {symmetry.translation.x() / kPeriod_m, symmetry.translation.y() / kPeriod_m})
      EXPECT_NEAR(periods, std::round(periods), 0.03);
    EXPECT_NEAR(symmetry.translation.z(), 0, 1e-3);
    one_period |= std::abs(symmetry.translation.norm() - kPeriod_m) < 1e-3 && quarter_turns < 0.01;
  }
  EXPECT_TRUE(one_period);
}

TEST(Ambiguity, APredictionExcludesAlternativesThatAreFartherOff) {
  const TwoViews views(blocks(false), camera_above(0, 0, 0), camera_above(0.02, 0.015, 4));
  const Eigen::Vector3d middle(0, 0, 1);
  const auto within = [&](double distance_m) {
    return views.report(
        [&, distance_m](const Pose& pose) { return (pose * middle - views.truth * middle).norm() <= distance_m; });
  };
  EXPECT_TRUE(within(0.6 * kPeriod_m).alternatives.empty());
  EXPECT_FALSE(within(1.1 * kPeriod_m).alternatives.empty());
}

TEST(Ambiguity, AUniqueObjectResolvesIt) {
  const TwoViews views(blocks(true), camera_above(0, 0, 0), camera_above(0.02, 0.015, 4));
  const AmbiguityReport report = views.report();
  EXPECT_FALSE(report.contradicted);
  EXPECT_TRUE(report.alternatives.empty());
}

TEST(Ambiguity, AWrongPoseIsContradictedOrHasABetterAlternative) {
  const TwoViews views(blocks(true), camera_above(0, 0, 0), camera_above(0.02, 0.015, 4));
  const Pose wrong = camera_above(0, 0, 0).inverse() * camera_above(0.02 + kPeriod_m, 0.015, 4);
  const AmbiguityReport report = find_alternatives(views.target, views.source, views.scene.rig.camera, wrong, {});
  ASSERT_TRUE(report.contradicted || !report.alternatives.empty());
  if (!report.alternatives.empty()) {
    EXPECT_GT(report.alternatives.front().log_likelihood, 0);
  }
}

TEST(Ambiguity, OrdinaryScenesHaveNoAlternatives) {
  const TwoViews views(boxes(), camera_above(0, 0, 0), camera_above(0.03, -0.02, 10));
  const AmbiguityReport report = views.report();
  EXPECT_FALSE(report.contradicted);
  EXPECT_GT(report.explained, 0.7);
  EXPECT_TRUE(report.alternatives.empty());
}

TEST(Ambiguity, FollowingWithoutAKnownPredictionIsAmbiguousOnAGrid) {
  const TwoViews views(blocks(false), camera_above(0, 0, 0), camera_above(0.02, 0.015, 4));
  RegistrationOptions options;
  options.tracking.max_prediction_error_m = 1.1 * kPeriod_m;
  const auto followed = [&](const Matrix6d& predicted_covariance) {
    return follow_view(views.target, views.source, views.truth, views.scene.rig.camera, 1, options, Matrix6d::Zero(),
                       predicted_covariance);
  };
  const ViewRegistration unknown = followed(Matrix6d::Zero());
  EXPECT_FALSE(unknown.found);
  EXPECT_TRUE(unknown.ambiguous);
  EXPECT_FALSE(unknown.alternatives.empty());
  const ViewRegistration known = followed(1e-6 * Matrix6d::Identity());
  EXPECT_TRUE(known.refined);
  EXPECT_FALSE(known.ambiguous);
  const Eigen::Vector3d middle(0, 0, 1);
  EXPECT_LT((known.earlier_from_current * middle - views.truth * middle).norm(), 1e-3);
}

TEST(Ambiguity, AmbiguousViewsStayOutOfTheMap) {
  // Textured blocks, so that landmarks suggest a pose.
  Scene scene = blocks(false);
  for (Object& object : scene.objects) {
    object.material.grain = Grain::stone;
    object.material.contrast = 0.4;
    object.material.grain_m = 0.008;
    object.texture_seed = 1;
  }
  // The floor is plain; otherwise its grain would distinguish the places.
  scene.objects.front().material = grey_object(plane_mesh(1, 1), {}, 0.4).material;
  set_cameras(scene, {camera_above(0, 0, 0), camera_above(0.04, 0.03, 3)});
  VirtualRig rig(scene, {});
  Pipeline pipeline(scene.rig, scene.patterns, {}, {});
  EXPECT_EQ(pipeline.process(*rig.capture(scene.patterns)).tracking, Tracking::first);
  const FrameResult second = pipeline.process(*rig.capture(scene.patterns));
  EXPECT_EQ(second.tracking, Tracking::ambiguous);
  EXPECT_FALSE(second.registration.alternatives.empty());
  EXPECT_FALSE(second.in_map);
  EXPECT_EQ(second.view, -1);
  EXPECT_EQ(pipeline.trajectory().size(), 1u);
  EXPECT_EQ(pipeline.map().keyframes().size(), 1u);
}

TEST(Ambiguity, MirroredViewsAreLost) {
  Scene scene = boxes();
  set_cameras(scene, {camera_above(0, 0, 0), camera_above(0.03, -0.02, 8)});
  VirtualRig rig(scene, {});
  const FringeStack first = *rig.capture(scene.patterns), second = *rig.capture(scene.patterns);
  for (const int axis : {0, 1}) {  // top to bottom, left to right
    Pipeline pipeline(scene.rig, scene.patterns, {}, {});
    pipeline.process(first);
    FringeStack mirrored = second;
    for (cv::Mat& image : mirrored.images) {
      cv::Mat flipped;
      cv::flip(image, flipped, axis);
      image = flipped;
    }
    EXPECT_FALSE(has_pose(pipeline.process(mirrored).tracking)) << axis;
    EXPECT_EQ(pipeline.process(second).tracking, Tracking::refined) << axis;
  }
}

// The mirror image of a plane is the plane seen from behind: a rigid motion maps one onto the other.
TEST(Ambiguity, DepthDoesNotConfirmAPlaneSeenFromBehind) {
  Scene scene = boxes();
  scene.objects.resize(1);  // the table
  const TwoViews views(std::move(scene), camera_above(0, 0, 0), camera_above(0.02, 0.01, 5));
  const Pinhole& camera = views.scene.rig.camera;
  const DepthAgreement right = depth_agreement(views.target, views.source, camera, views.truth, 1e-3);
  EXPECT_GT(right.overlap, 0.7);
  EXPECT_GT(right.agrees, 0.98);
  // Half a turn about an axis in the table's surface.
  const Pose to_table{Eigen::Matrix3d::Identity(), {0, 0, 1}};
  const Pose half_turn = to_table * Pose{rotation_exp({kPi, 0, 0}), {0, 0, 0}} * to_table.inverse();
  const DepthAgreement behind = depth_agreement(views.target, views.source, camera, half_turn * views.truth, 1e-3);
  EXPECT_GT(behind.overlap, 0.7);
  EXPECT_LT(behind.agrees, 0.02);
}

}  // namespace
}  // namespace fringeslam::sim
