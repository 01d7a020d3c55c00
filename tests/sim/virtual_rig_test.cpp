// SPDX-License-Identifier: Apache-2.0
#include "sim/virtual_rig.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <tuple>
#include <utility>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/score/truth_files.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/matchers.h"
#include "tests/support/same_pixels.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

// Returns the thesis rig with a quarter of the camera pixels; field of view and distortion are unchanged.
RigModel small_thesis_rig() {
  RigModel rig = read_rig(std::filesystem::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/thesis.yaml");
  rig.robot_from_camera = Pose{};
  Pinhole& camera = rig.camera;
  camera = {camera.width / 2,      camera.height / 2,     camera.fx / 2,    camera.fy / 2,
            (camera.cx - 0.5) / 2, (camera.cy - 0.5) / 2, camera.distortion};
  return rig;
}

// Returns a scene with a tilted, textured board 1 m in front of the camera, and two poses.
Scene board_scene() {
  Object board = grey_object(plane_mesh(2, 2), pose_from({{0, 0, 1000}, {12, -18, 5}}));
  board.material = {.grain = Grain::stone, .albedo = 0.6, .contrast = 0.3, .grain_m = 0.01};
  Scene scene = world_of({board}, small_thesis_rig());
  scene.seed = 5;
  scene.ambient_lux = 200;
  scene.trajectory = {{0.0, Pose{}}, {0.5, pose_from({{20, 10, -30}, {2, 3, -4}})}};
  return scene;
}

PatternSequence fringes(const RigModel& rig, int bits) {
  return phase_shift_sequence(rig.projector.width, rig.projector.height, {1040, 131, 16.5}, 3, Axis::columns, bits);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

int differing(const cv::Mat& a, const cv::Mat& b) { return cv::countNonZero(a != b); }

// Without noise and quantisation, decoding recovers the rendered depth.
TEST(VirtualRig, DecodedDepthIsTheTrueDepth) {
  const Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 0);
  VirtualRig rig(scene, {1, false, false, Effects::none()});
  const PixelRays rays = pixel_rays(scene.rig.camera);
  DepthOptions options;
  options.texture_correction = false;  // a single sample sees a point instead of a pixel's square
  int views = 0;
  while (const auto view = rig.simulate(sequence)) {
    EXPECT_EQ(view->truth.index, view->stack.index);
    EXPECT_EQ(view->stack.index, views++);
    const DecodedStack decoded = decode(view->stack, scene.rig, {});
    const Frame frame = reconstruct(decoded, scene.rig, rays, options);
    const TruthFrame& exact = view->truth;
    std::vector<double> depth_errors_m, column_errors_px;
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        if (!frame.valid(row, col)) continue;
        depth_errors_m.push_back(std::abs(frame.points_m(row, col)[2] - exact.depth_m(row, col)));
        column_errors_px.push_back(std::abs(decoded.coordinate_px(row, col) - exact.projector_column(row, col)));
      }
    }
    ASSERT_GT(depth_errors_m.size(), 60000u);
    EXPECT_LT(median(depth_errors_m), 1e-6);
    EXPECT_LT(*std::max_element(depth_errors_m.begin(), depth_errors_m.end()), 5e-6);
    EXPECT_LT(median(column_errors_px), 2e-4);
  }
  EXPECT_EQ(views, 2);
}

TEST(VirtualRig, TruthIsThatOfThePlane) {
  const Scene scene = board_scene();
  std::vector<TruthFrame> truth;
  VirtualRig rig(scene, {1, false, false, Effects::none()});
  while (auto view = rig.simulate(fringes(scene.rig, 0))) truth.push_back(std::move(view->truth));
  ASSERT_EQ(truth.size(), 2u);
  for (const TruthFrame& frame : truth) {
    const TimedPose& pose = scene.trajectory.at(static_cast<size_t>(frame.index));
    EXPECT_EQ(frame.timestamp_s, pose.timestamp_s);
    EXPECT_EQ(frame.world_from_robot.rotation, pose.world_from_robot.rotation);
    EXPECT_EQ(frame.world_from_robot.translation, pose.world_from_robot.translation);
    const Pose camera_from_board = pose.world_from_robot.inverse() * scene.objects[0].world_from_object;
    const Eigen::Vector3d normal = -camera_from_board.rotation.col(2);
    for (int row = 0; row < frame.depth_m.rows; row += 10) {
      for (int col = 0; col < frame.depth_m.cols; col += 10) {
        const Eigen::Vector3d ray = scene.rig.camera.undistort(Eigen::Vector2d(col, row)).homogeneous();
        const double depth = normal.dot(camera_from_board.translation) / normal.dot(ray);
        ASSERT_NEAR(frame.depth_m(row, col), depth, 1e-7);
        const Eigen::Vector3d in_projector = scene.rig.projector_from_camera * Eigen::Vector3d(depth * ray);
        ASSERT_NEAR(frame.projector_column(row, col), scene.rig.projector.project(in_projector).x(), 1e-4);
        for (int i = 0; i < 3; ++i) ASSERT_NEAR(frame.normals(row, col)[i], normal[i], 1e-6);
      }
    }
  }
}

TEST(VirtualRig, TruthIsReadAsItWasWritten) {
  const test::TempFolder folder;
  Scene scene = board_scene();
  scene.objects[0].material.temperature_c = 30;
  const TruthFrame truth = VirtualRig(scene, {}).truth_of(1);
  write_truth(truth, folder.path());
  const TruthFrame read = read_truth_frame(folder / (stack_name(1) + ".exr"));
  EXPECT_TRUE(test::same_pixels(read.depth_m, truth.depth_m));
  EXPECT_TRUE(test::same_pixels(read.position_m, truth.position_m));
  EXPECT_TRUE(test::same_pixels(read.normals, truth.normals));
  EXPECT_TRUE(test::same_pixels(read.object_id, truth.object_id));
  EXPECT_TRUE(test::same_pixels(read.projector_column, truth.projector_column));
  EXPECT_TRUE(test::same_pixels(read.projector_row, truth.projector_row));
  EXPECT_TRUE(test::same_pixels(read.temperature_c, truth.temperature_c));
  EXPECT_TRUE(test::same_pixels(read.mask, truth.mask));
}

TEST(VirtualRig, HandsOutOneStackAPoseAndThenNothing) {
  const Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 8);
  VirtualRig rig(scene, {1, true, true});
  for (int index = 0; index < 2; ++index) {
    const auto stack = rig.capture(sequence);
    ASSERT_TRUE(stack);
    EXPECT_EQ(stack->index, index);
    EXPECT_EQ(stack->timestamp_s, 0.5 * index);
    EXPECT_TRUE(stack->patterns == sequence);
    EXPECT_EQ(stack->exposure_s.size(), 9u);
    EXPECT_EQ(stack->exposure_time_s, exposure_times_s(0.5 * index, sequence, scene.rig.timing));
    ASSERT_EQ(stack->images.size(), 9u);
    for (const cv::Mat& image : stack->images) {
      EXPECT_EQ(image.type(), CV_8UC1);
      EXPECT_EQ(image.size(), cv::Size(266, 250));
    }
  }
  EXPECT_FALSE(rig.capture(sequence));
  EXPECT_FALSE(rig.capture(sequence));
}

TEST(VirtualRig, SameSeedSameImagesOtherSeedOtherNoise) {
  Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 8);
  const auto first_stack = [&] { return VirtualRig(scene, {4, true, true}).capture(sequence).value(); };
  const FringeStack first = first_stack(), second = first_stack();
  scene.seed = 6;
  const FringeStack other = first_stack();
  for (size_t i = 0; i < first.images.size(); ++i) {
    EXPECT_EQ(differing(first.images[i], second.images[i]), 0);
    EXPECT_GT(differing(first.images[i], other.images[i]), 10000);
  }
}

// Corners that a lens's distortion polynomial does not reach are black, also in haze and with light between surfaces.
TEST(VirtualRig, PixelsWithoutARaySeeNothing) {
  Scene scene = board_scene();
  scene.air = {0.3, 0.8, 0};
  scene.bounces = 2;
  Pinhole& camera = scene.rig.camera;
  // r (1 + k r^2) is largest at r^2 = -1 / (3 k), where it is 2/3 r: within the corners.
  const double corner = std::hypot(camera.cx / camera.fx, camera.cy / camera.fy), r = 1.5 * 0.95 * corner;
  camera.distortion = {-1 / (3 * r * r), 0, 0, 0, 0};
  const PixelRays rays = pixel_rays(camera);
  VirtualRig rig(scene, {1, false, false, {}});
  const auto view = rig.simulate(fringes(scene.rig, 0));
  const cv::Mat1f image = view->stack.images[0];
  ASSERT_TRUE(cv::checkRange(image));
  int without = 0;
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) {
      if (std::isfinite(rays(row, col)[0])) continue;
      ++without;
      EXPECT_TRUE(std::isnan(view->truth.depth_m(row, col)));
    }
  }
  EXPECT_GT(without, 50);
  EXPECT_LT(image(0, 0), 0.2 * image(image.rows / 2, image.cols / 2));
}

TEST(VirtualRig, GroundTruthChangesNoImage) {
  const Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 8);
  VirtualRig with(scene, {4, true, true}), without(scene, {4, true, true});
  for (int index = 0; index < 2; ++index) {
    const auto view = with.simulate(sequence);
    const auto stack = without.capture(sequence);
    ASSERT_TRUE(view && stack);
    for (size_t i = 0; i < 9; ++i) EXPECT_EQ(differing(view->stack.images[i], stack->images[i]), 0);
  }
  EXPECT_FALSE(with.simulate(sequence));
}

TEST(VirtualRig, ThreadsDoNotChangeAnImage) {
  const Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 8);
  const int before = cv::getNumThreads();
  std::vector<FringeStack> stacks;
  for (const int threads : {1, 2}) {
    cv::setNumThreads(threads);
    stacks.push_back(VirtualRig(scene, {4, true, false}).capture(sequence).value());
  }
  cv::setNumThreads(before);
  for (size_t i = 0; i < 9; ++i) EXPECT_EQ(differing(stacks[0].images[i], stacks[1].images[i]), 0);
}

TEST(VirtualRig, LooksAtAScreenAsAtThePatternThatItShows) {
  const Scene scene = board_scene();
  const PatternSequence sequence = fringes(scene.rig, 8);
  const RenderOptions options{4, false, true, {}};
  const auto stack = VirtualRig(scene, options).capture(sequence);
  VirtualRig rig(scene, options);
  for (size_t i = 0; i < stack->images.size(); ++i) {
    cv::Mat line = pattern_image(sequence.patterns[i], sequence), screen;
    cv::repeat(line, sequence.height / line.rows, sequence.width / line.cols, screen);
    const cv::Mat seen = rig.look(screen, 0, stack->exposure_s[i], static_cast<int>(i));
    EXPECT_LE(cv::norm(seen, stack->images[i], cv::NORM_INF), 1) << i;  // 8-bit levels, rounded
    EXPECT_GT(cv::mean(seen)[0], 20) << i;
    // A screen that varies along both axes, here by one corner pixel, is blurred by a different code path.
    screen.at<uchar>(0, 0) ^= 1;
    const cv::Mat other = rig.look(screen, 0, stack->exposure_s[i], static_cast<int>(i));
    EXPECT_LE(cv::norm(other, stack->images[i], cv::NORM_INF), 1) << i;
  }
  EXPECT_THROW(rig.look(cv::Mat1b(10, 10, uchar{0}), 0, 0.01, 0), Error);
}

TEST(RenderOptions, WantASquareNumberOfSamples) {
  for (const int samples : {1, 4, 9, 16, 256}) EXPECT_NO_THROW((RenderOptions{samples, true, true}.check()));
  for (const int samples : {-4, 0, 2, 3, 8, 257, 289})
    EXPECT_THROW((RenderOptions{samples, true, true}.check()), Error) << samples;
}

// Two poses at one time have no meaning.
TEST(VirtualRig, ViewsInMotionMustNotOverlap) {
  Scene scene = board_scene();  // 0.5 s between views
  scene.motion.velocity_m_s.x() = 0.01;
  const PatternSequence sequence = fringes(scene.rig, 0);
  scene.rig.timing.camera_rate_hz = static_cast<double>(sequence.patterns.size()) / 0.5;
  EXPECT_TRUE(VirtualRig(scene, {1, false, false, Effects::none()}).capture(sequence));
  scene.rig.timing.camera_rate_hz *= 0.99;
  EXPECT_THAT(support::error_of([&] {
                VirtualRig(scene, {1, false, false, only(&Effects::motion)}).capture(sequence);
              }),
              testing::HasSubstr("trajectory.interval_s: 9 images per view"));
  scene.motion = {};
  EXPECT_TRUE(VirtualRig(scene, {1, false, false, Effects::none()}).capture(sequence));
}

cv::Mat1b mixed_pixels(Mesh mesh, const Pose& pose) {
  const Scene scene = world_of({grey_object(std::move(mesh), pose)}, coaxial_rig());
  const TruthFrame truth = VirtualRig(scene, {16, false, false, Effects::none()}).truth_of(0);
  cv::Mat1b mixed(truth.mask.size());
  std::transform(truth.mask.begin(), truth.mask.end(), mixed.begin(), [](float mask) {
    const int bits = static_cast<int>(mask);
    return static_cast<uchar>((bits & kTruthMixed) ? 1 : 0);
  });
  return mixed;
}

// An edge between parallel faces of one object, 30 mm apart in depth: six footprints of a pixel.
TEST(TruthMask, AStepOfOneObjectIsMixed) {
  Mesh step;
  constexpr double kEdge = 7e-4;  // at column 32.14
  for (const auto& [left, right, z] : {std::tuple(-0.5, kEdge, 1.0), std::tuple(kEdge, 0.5, 1.03)}) {
    const int first = static_cast<int>(step.vertices.size());
    for (const double y : {-0.5, 0.5}) step.vertices.insert(step.vertices.end(), {{left, y, z}, {right, y, z}});
    step.triangles.insert(step.triangles.end(), {{first, first + 2, first + 1}, {first + 1, first + 2, first + 3}});
  }
  const cv::Mat1b mixed = mixed_pixels(std::move(step), {});
  for (int row = 0; row < mixed.rows; ++row) {
    for (int col = 0; col < mixed.cols; ++col) ASSERT_EQ(mixed(row, col), col == 32) << row << " " << col;
  }
}

// The surface of a pixel may reach far in depth without an edge.
TEST(TruthMask, AFloorAtGrazingIncidenceIsNotMixed) {
  Pose below;
  below.rotation = rotation_exp({kPi / 2, 0, 0});  // its upper side faces the camera's axis
  below.translation = {0, 0.05, 2.6};
  const cv::Mat1b mixed = mixed_pixels(plane_mesh(5, 5), below);
  // The floor ends at row 26 and column 32 +- 2.5 / 0.05 (row - 24).
  for (int row = 28; row < mixed.rows; ++row) {
    for (int col = 0; col < mixed.cols; ++col) ASSERT_EQ(mixed(row, col), 0) << row << " " << col;
  }
}

TEST(TruthMask, ASphereIsMixedAtItsOutlineOnly) {
  Pose ahead;
  ahead.translation.z() = 1;
  const cv::Mat1b mixed = mixed_pixels(sphere_mesh(0.1, 6), ahead);
  const double outline_px = 200 * std::tan(std::asin(0.1));
  int inside = 0;
  for (int row = 0; row < mixed.rows; ++row) {
    for (int col = 0; col < mixed.cols; ++col) {
      if (std::hypot(col - 32, row - 24) > outline_px - 1) continue;
      ASSERT_EQ(mixed(row, col), 0) << row << " " << col;
      ++inside;
    }
  }
  EXPECT_GT(inside, 1000);
}

}  // namespace
}  // namespace fringeslam::sim
