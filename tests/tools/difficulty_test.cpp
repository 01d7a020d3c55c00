// SPDX-License-Identifier: Apache-2.0
// The difficulty of views whose difficulty is known in closed form or by construction.
#include "tools/authoring/difficulty.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>

#include "core/mapper/front_end.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"
#include "sim/scene/scene.h"
#include "sim/virtual_rig.h"

namespace fringeslam::tools {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

sim::Scene scene_of(const std::string& objects, const std::string& trajectory, const std::string& more = "") {
  sim::SceneLoadOptions reading;
  reading.text =
      "name: difficult\n"
      "rig: {file: ../rigs/thesis.yaml, robot_from_camera: {translation_m: [0, 0, 0]}}\n"
      "patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}\n"
      "light: {ambient_lux: 290}\n"
      "materials:\n"
      "  board: {grain: plain, albedo: 0.6}\n"
      "  stone: {grain: stone, albedo: 0.5, contrast: 0.4, grain_m: 0.03}\n"
      "objects:\n" +
      objects + more + trajectory;
  return sim::load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/flat_board/difficult.yaml", reading);
}

std::string board_at(double z_m) {
  return "  - {shape: plane, size_m: [2, 2], material: board, pose: {translation_m: [0, 0, " + std::to_string(z_m) +
         "], rotation_deg: [180, 0, 0]}}\n";
}

// Rocks in front of a board determine all motions.
const std::string kRocks =
    board_at(1.05) +
    "  - {shape: rock, size_m: [0.1, 0.09, 0.08], material: stone, pose: {translation_m: [-0.04, -0.03, 1]}}\n"
    "  - {shape: rock, size_m: [0.08, 0.09, 0.1], material: stone, pose: {translation_m: [0.06, 0.05, 1]}}\n";

std::string moves(const std::vector<std::string>& steps_mm) {
  std::string text = "trajectory:\n  motions:\n";
  for (const std::string& step : steps_mm) text += "    - {translation_mm: [" + step + "], rotation_deg: [0, 0, 0]}\n";
  return text;
}

std::vector<ViewDifficulty> assessed(const sim::Scene& scene, size_t most = 10) {
  std::vector<ViewDifficulty> views;
  sim::SensorView view(scene);
  assess_difficulty(scene, view, most, [&](const ViewDifficulty& found) { views.push_back(found); });
  return views;
}

std::string reason(const ViewDifficulty& view, Hardship which) { return view.reason[static_cast<size_t>(which)]; }

TEST(Difficulty, RocksAreEasy) {
  const auto views = assessed(scene_of(kRocks, moves({"10, 0, 0"})));
  ASSERT_EQ(views.size(), 2u);
  for (const ViewDifficulty& view : views) {
    EXPECT_LT(view.worst(), 1);
    EXPECT_THAT(view.reason, testing::Each(IsEmpty()));
    EXPECT_GT(view.measured, 0.5);
  }
  EXPECT_FALSE(views[0].overlap);
  EXPECT_FALSE(views[0].translation_m);
  ASSERT_TRUE(views[1].translation_m);
  EXPECT_LT(views[1].translation_m->maxCoeff(), 1e-4);
}

TEST(Difficulty, OverAFlatBoardTheMotionInItsPlaneIsUndetermined) {
  const auto views = assessed(scene_of(board_at(1), moves({"10, 0, 0"})));
  const ViewDifficulty& view = views.at(1);
  EXPECT_FALSE(view.translation_m);
  EXPECT_TRUE(std::isinf(*view.displacement_m));
  EXPECT_THAT(reason(view, Hardship::motion), HasSubstr("slides along (1.00, 0.00, 0.00), slides along (0.00, 1.00"));
  EXPECT_THAT(reason(view, Hardship::motion), HasSubstr("turns about (0.00, 0.00, 1.00)"));
  EXPECT_THAT(reason(view, Hardship::range), IsEmpty());
  EXPECT_THAT(reason(view, Hardship::overlap), IsEmpty());
}

// The bound of reduced images is that of the full ones, which the scoring computes from their depth.
TEST(Difficulty, TheBoundIsThatOfTheFullImages) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/boxes_and_foam/scene.yaml");
  const RigModel& rig = scene.rig;
  const PixelRays rays = pixel_rays(rig.camera);
  sim::VirtualRig camera(scene, {});
  const FringeFrontEnd front_end(rig, scene.patterns, {.decode = {}, .depth = {}, .at_rest = true});
  std::vector<sim::SimulatedView> full;
  std::vector<cv::Mat1f> sigma_m;
  while (auto view = camera.simulate(scene.patterns)) {
    sigma_m.push_back(front_end.reconstruct(view->stack, {}).frame.sigma_m);
    full.push_back(std::move(*view));
  }
  const auto views = assessed(scene);
  ASSERT_EQ(views.size(), full.size());
  for (size_t i = 1; i < views.size(); ++i) {
    const Pose before = full[i - 1].truth.world_from_robot, current = full[i].truth.world_from_robot;
    const Pose motion = (before * rig.robot_from_camera).inverse() * current * rig.robot_from_camera;
    const Matrix6d bound = inverse(
        pose_information(full[i - 1].truth, sigma_m[i - 1], full[i].truth, sigma_m[i], rig.camera, rays, motion));
    ASSERT_TRUE(views[i].rotation_rad);
    const Eigen::Vector3d expected =
        rig.robot_from_camera.rotation * Eigen::Vector3d(bound.diagonal().head<3>().cwiseSqrt());
    EXPECT_NEAR(views[i].rotation_rad->norm() / expected.norm(), 1, 0.4) << i;
    // Change of the robot's motion per change of the camera's, by differences.
    Matrix6d jacobian;
    const auto of_robot = [&](const Pose& of_camera) {
      return rig.robot_from_camera * of_camera * rig.robot_from_camera.inverse();
    };
    for (int k = 0; k < 6; ++k)
      jacobian.col(k) = difference(of_robot(retract(motion, 1e-6 * Vector6d::Unit(k))), of_robot(motion)) / 1e-6;
    const Matrix6d of_motion = jacobian * bound * jacobian.transpose();
    EXPECT_NEAR(views[i].translation_m->norm() / std::sqrt(of_motion.diagonal().tail<3>().sum()), 1, 0.4) << i;
  }
}

TEST(Difficulty, BeyondTheRangeAViewIsDifficult) {
  const ViewDifficulty far = assessed(scene_of(board_at(1.8), "trajectory: {}\n")).at(0);
  EXPECT_NEAR(far.far, far.lit, 1e-12);
  EXPECT_EQ(far.in_range, 0);
  EXPECT_THAT(reason(far, Hardship::range), HasSubstr("see surfaces beyond far_m, 1.4 m"));
  const ViewDifficulty near = assessed(scene_of(board_at(0.6), "trajectory: {}\n")).at(0);
  EXPECT_THAT(reason(near, Hardship::range), HasSubstr("nearer than near_m, 0.7 m"));
  const ViewDifficulty nothing =
      assessed(scene_of(board_at(1), "trajectory:\n  start: {rotation_deg: [90, 0, 0]}\n")).at(0);
  EXPECT_THAT(reason(nothing, Hardship::range), HasSubstr("only 0 % see a surface"));
  EXPECT_THAT(reason(nothing, Hardship::depth), HasSubstr("only 0 % of the pixels yield a depth"));
}

TEST(Difficulty, BlackSurfacesYieldNoDepth) {
  sim::Scene scene = scene_of(board_at(1), "trajectory: {}\n");
  for (sim::Object& object : scene.objects) object.material.albedo = 1e-3;
  const ViewDifficulty view = assessed(scene).at(0);
  EXPECT_THAT(reason(view, Hardship::range), IsEmpty());
  EXPECT_THAT(reason(view, Hardship::depth), Not(IsEmpty()));
}

// The view is 0.26 m wide at 1 m.
TEST(Difficulty, TheOverlapIsTheShareSeenBefore) {
  const auto views = assessed(scene_of(board_at(1), moves({"65, 0, 0", "220, 0, 0"})));
  EXPECT_NEAR(*views.at(1).overlap, 0.75, 0.02);
  EXPECT_THAT(reason(views.at(1), Hardship::overlap), IsEmpty());
  EXPECT_THAT(reason(views.at(2), Hardship::overlap), HasSubstr("were measured by the view before"));
}

TEST(Difficulty, EqualBlocksInAGridRepeat) {
  std::string blocks = board_at(1);
  for (int i = -5; i <= 5; ++i) {
    for (int j = -5; j <= 5; ++j)
      blocks += "  - {shape: box, size_m: [0.03, 0.025, 0.02], material: board, pose: {translation_m: [" +
                std::to_string(0.05 * i) + ", " + std::to_string(0.05 * j) + ", 0.99]}}\n";
  }
  const ViewDifficulty view = assessed(scene_of(blocks, moves({"7, 3, 0"}))).at(1);
  ASSERT_TRUE(view.repeats_m);
  // By whole periods along both axes.
  const double squared_periods = std::pow(*view.repeats_m / 0.05, 2);
  EXPECT_NEAR(squared_periods, std::round(squared_periods), 0.2);
  EXPECT_GT(squared_periods, 0.8);
  EXPECT_THAT(reason(view, Hardship::repetition), HasSubstr("the views look alike elsewhere"));
}

// At 1 m, v t f / z px.
TEST(Difficulty, ImageMotionFollowsFromSpeedAndFrameRate) {
  sim::Scene scene = scene_of(board_at(1), "trajectory: {}\n");
  scene.motion.velocity_m_s = {0.3, 0, 0};
  const double at_1m_px = scene.rig.camera.fx / scene.rig.timing.camera_rate_hz;
  EXPECT_NEAR(assessed(scene).at(0).step_px, 0.3 * at_1m_px, 0.05);
  EXPECT_THAT(reason(assessed(scene).at(0), Hardship::speed), IsEmpty());
  scene.motion.velocity_m_s = {3, 0, 0};
  EXPECT_THAT(reason(assessed(scene).at(0), Hardship::speed), HasSubstr("at 90 images/s"));
}

TEST(Difficulty, ViewsOfAPathAreThoseOfTheRig) {
  const std::string path =
      "trajectory:\n  continuous: {speed_m_s: 0.2}\n  spline:\n    waypoints:\n"
      "      - {camera_m: [-0.05, 0, 0], look_at_m: [-0.05, 0, 1]}\n"
      "      - {camera_m: [0.05, 0, 0], look_at_m: [0.05, 0, 1]}\n";
  const sim::Scene scene = scene_of(kRocks, path);
  ASSERT_TRUE(scene.path);
  sim::VirtualRig rig(scene, {});
  std::vector<double> times_s;
  while (const auto stack = rig.capture(scene.patterns)) times_s.push_back(stack->timestamp_s);
  EXPECT_EQ(view_count(scene), times_s.size());
  const auto views = assessed(scene, 2);
  ASSERT_EQ(views.size(), 2u);
  for (const ViewDifficulty& view : views) EXPECT_NEAR(view.time_s, times_s.at(view.view), 1e-9);
  EXPECT_NEAR(views[1].step_px, 0.2 * scene.rig.camera.fx / 90, 1);
  EXPECT_TRUE(views[1].overlap);
}

TEST(Difficulty, StopsWhenAsked) {
  const sim::Scene scene = scene_of(kRocks, moves({"10, 0, 0", "10, 0, 0"}));
  sim::SensorView view(scene);
  size_t found = 0;
  assess_difficulty(
      scene, view, 10, [&](const ViewDifficulty&) { ++found; }, [&] { return found == 1; });
  EXPECT_EQ(found, 1u);
}

}  // namespace
}  // namespace fringeslam::tools
