// SPDX-License-Identifier: Apache-2.0
// Tests that changed inputs act as the mathematics predicts: rigid motions of the world, permuted patterns, scaled
// light, more noise, turned images.
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <numeric>
#include <opencv2/core.hpp>
#include <random>

#include "core/check/conventions.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/fringes.h"

namespace fringeslam::sim {
namespace {

// Three views of boxes and foam by a square camera, so that its images can be transposed.
Scene square_scene() {
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/boxes_and_foam/scene.yaml");
  Pinhole& camera = scene.rig.camera;
  constexpr int kSize = 320;
  camera.cx -= (camera.width - kSize) / 2, camera.cy -= (camera.height - kSize) / 2;
  camera.width = camera.height = kSize;
  scene.trajectory.resize(3);
  return scene;
}

std::vector<FringeStack> stacks_of(const Scene& scene) {
  VirtualRig rig(scene, {});
  std::vector<FringeStack> stacks;
  while (auto stack = rig.capture(scene.patterns)) stacks.push_back(std::move(*stack));
  return stacks;
}

std::vector<FrameResult> results_of(const Scene& scene, const std::vector<FringeStack>& stacks) {
  Pipeline pipeline(scene.rig, scene.patterns, {}, {});
  std::vector<FrameResult> results;
  for (const FringeStack& stack : stacks) results.push_back(pipeline.process(stack));
  return results;
}

double mahalanobis(const Pose& estimate, const Pose& truth, const Matrix6d& covariance) {
  const Vector6d off = difference(estimate, truth);
  return std::sqrt(off.dot(covariance.inverse() * off));
}

TEST(Symmetry, ARigidMotionOfTheWorldChangesNoRelativeResult) {
  const Scene scene = square_scene();
  Scene moved = scene;
  Pose motion;
  motion.rotation = rotation_exp({0.7, -1.1, 2.3});
  motion.translation = {12, -7, 3.5};
  for (Object& object : moved.objects) object.world_from_object = motion * object.world_from_object;
  for (TimedPose& timed : moved.trajectory) timed.world_from_robot = motion * timed.world_from_robot;
  moved.dust.up = motion.rotation * moved.dust.up;
  const auto stacks = stacks_of(scene), moved_stacks = stacks_of(moved);
  // Rounding of coordinates moves a few gray values across the border between two levels.
  for (size_t view = 0; view < stacks.size(); ++view) {
    for (size_t k = 0; k < stacks[view].images.size(); ++k) {
      cv::Mat off;
      cv::absdiff(stacks[view].images[k], moved_stacks[view].images[k], off);
      EXPECT_LT(cv::countNonZero(off), 0.002 * static_cast<double>(off.total()));
    }
  }
  const auto here = results_of(scene, stacks), there = results_of(moved, moved_stacks);
  ASSERT_EQ(here.size(), 3u);
  for (size_t view = 1; view < here.size(); ++view) {
    ASSERT_TRUE(has_pose(here[view].tracking));
    EXPECT_EQ(here[view].tracking, there[view].tracking);
    const Pose a = here[view].registration.earlier_from_current, b = there[view].registration.earlier_from_current;
    EXPECT_LT(mahalanobis(a, b, here[view].covariance), 0.3) << view;
    const double log_ratio = std::log(there[view].covariance.determinant() / here[view].covariance.determinant());
    EXPECT_NEAR(log_ratio / 12, 0, 0.02) << "sigmas of view " << view;
  }
}

TEST(Symmetry, TheOrderOfPatternsDoesNotMatter) {
  const Scene scene = square_scene();
  const FringeStack stack = stacks_of(scene)[0];
  const DecodedStack expected = decode(stack, scene.rig, {});
  std::vector<size_t> order(stack.images.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::mt19937 random(7);
  for (int trial = 0; trial < 5; ++trial) {
    for (size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random() % (i + 1)]);
    FringeStack permuted = stack;
    for (size_t i = 0; i < order.size(); ++i) {
      permuted.images[i] = stack.images[order[i]];
      permuted.patterns.patterns[i] = stack.patterns.patterns[order[i]];
    }
    const DecodedStack decoded = decode(permuted, scene.rig, {});
    int differing = 0, valid = 0;
    for (int row = 0; row < expected.coordinate_px.rows; ++row) {
      for (int col = 0; col < expected.coordinate_px.cols; ++col) {
        const float a = expected.coordinate_px(row, col), b = decoded.coordinate_px(row, col);
        const float sigma = expected.sigma_px(row, col);
        if (std::isnan(a) && std::isnan(b)) continue;
        ++valid;
        differing += !(std::abs(a - b) < 0.01f * sigma && std::abs(decoded.sigma_px(row, col) - sigma) < 1e-3f * sigma);
      }
    }
    ASSERT_GT(valid, 50000);
    // A pixel at the limit of a test may pass it in one order only.
    EXPECT_LE(differing, valid / 10000);
  }
}

// Fringes in float images, without rounding: coordinates do not depend on the light, and the variance of the phase is
// a / s + b / s^2 for light scaled by s: shot noise and dark noise.
TEST(Symmetry, LightScalesTheSigmaNotThePhase) {
  RigModel rig = square_scene().rig;
  rig.sensor.offset_dn = 0;
  const int width = rig.projector.width;
  const PatternSequence sequence =
      phase_shift_sequence(width, rig.projector.height, {1.0 * width}, 4, Axis::columns, 0);
  const auto seen = [&](double light) {
    cv::Mat1d columns(1, 200);
    for (int i = 0; i < columns.cols; ++i) columns(0, i) = 20 + i * (width - 40.0) / columns.cols;
    const FringeStack stack = support::fringe_stack(columns, sequence, {40 * light, 30 * light}, CV_32FC1);
    return decode(stack, rig, {});
  };
  const DecodedStack faint = seen(1), middle = seen(1.5), bright = seen(3);
  for (int i = 0; i < faint.coordinate_px.cols; ++i) {
    ASSERT_NEAR(middle.coordinate_px(0, i), faint.coordinate_px(0, i), 2e-3);
    ASSERT_NEAR(bright.coordinate_px(0, i), faint.coordinate_px(0, i), 2e-3);
    const auto variance = [&](const DecodedStack& decoded) { return std::pow(decoded.sigma_px(0, i), 2); };
    // v(1) = a + b, v(3) = a / 3 + b / 9.
    const double b = (variance(faint) - 3 * variance(bright)) * 1.5, a = variance(faint) - b;
    ASSERT_NEAR(variance(middle) / (a / 1.5 + b / 2.25), 1, 1e-4);
    ASSERT_GT(a, 0);
    ASSERT_GT(b, 0);
  }
}

TEST(Symmetry, DoubledNoiseDoublesTheSigma) {
  RigModel rig = square_scene().rig;
  rig.sensor.offset_dn = 0;
  const int width = rig.projector.width;
  const PatternSequence sequence =
      phase_shift_sequence(width, rig.projector.height, {1.0 * width}, 3, Axis::columns, 0);
  const auto sigma = [&](double gain, double dark_electrons) {
    rig.sensor.gain_dn_per_electron = gain;
    rig.sensor.full_well_electrons = 255 / gain;
    rig.sensor.dark_noise_electrons = dark_electrons;
    const cv::Mat1d columns(1, 1, 371.0);
    return decode(support::fringe_stack(columns, sequence, {100, 70}, CV_32FC1), rig, {}).sigma_px(0, 0);
  };
  // Variance of a gray value: g^2 d^2 + g y + 1/12. The last term is that of rounding and remains.
  const double g = 1.0 / 150, d = 25;
  const double none = std::pow(sigma(1e-12, 0), 2), once = std::pow(sigma(g, d), 2);
  const double twice = std::pow(sigma(4 * g, d / 2), 2);
  EXPECT_NEAR((twice - none) / (once - none), 4, 1e-3);
}

struct Turn {
  const char* name;
  bool transposed;
  int flip;  // of cv::flip; 2: none
};

FringeStack turned(const FringeStack& stack, const Turn& turn) {
  FringeStack result = stack;
  for (cv::Mat& image : result.images) {
    image = turn.transposed ? cv::Mat(image.t()) : image.clone();
    if (turn.flip != 2) cv::flip(image, image, turn.flip);
  }
  return result;
}

constexpr std::array<Turn, 7> kTurns = {{{"left to right", false, 1},
                                         {"top to bottom", false, 0},
                                         {"half a turn", false, -1},
                                         {"transposed", true, 2},
                                         {"quarter turn", true, 1},
                                         {"other quarter turn", true, 0},
                                         {"other diagonal", true, -1}}};

// One view is turned, such as one from another camera in the folder of a recording.
TEST(Symmetry, ATurnedViewIsNotConfidentlyWrong) {
  const Scene scene = square_scene();
  const auto stacks = stacks_of(scene);
  const Pose truth = (scene.trajectory[0].world_from_robot * scene.rig.robot_from_camera).inverse() *
                     (scene.trajectory[1].world_from_robot * scene.rig.robot_from_camera);
  for (const Turn& turn : kTurns) {
    Pipeline pipeline(scene.rig, scene.patterns, {}, {});
    pipeline.process(stacks[0]);
    const FrameResult result = pipeline.process(turned(stacks[1], turn));
    if (has_pose(result.tracking)) {
      EXPECT_LT(mahalanobis(result.registration.earlier_from_current, truth, result.covariance), 6) << turn.name;
    }
    EXPECT_TRUE(has_pose(pipeline.process(stacks[2]).tracking)) << "after " << turn.name;
  }
}

// All views are turned. Images flipped top to bottom show a mirrored world, which column patterns do not distinguish; its
// views are registered with their mirrored motion. All others are refused, or no view gets a pose.
TEST(Symmetry, TurnedRecordingsAreRefused) {
  const Scene scene = square_scene();
  const auto stacks = stacks_of(scene);
  for (const Turn& turn : kTurns) {
    if (!turn.transposed && turn.flip == 0) continue;
    std::vector<FringeStack> all;
    for (const FringeStack& stack : stacks) all.push_back(turned(stack, turn));
    if (!reason_for_turned_images(all[0], scene.rig).empty()) continue;
    int posed = 0;
    for (const FrameResult& result : results_of(scene, all)) posed += has_pose(result.tracking);
    EXPECT_LE(posed, 1) << turn.name << ": " << posed << " of 3 views have a pose";
  }
}

}  // namespace
}  // namespace fringeslam::sim
