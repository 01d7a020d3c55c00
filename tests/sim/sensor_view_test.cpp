// SPDX-License-Identifier: Apache-2.0
// The full view is what the virtual rig captures; the reduced one is a smaller image of the same.
#include "sim/sensor_view.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

// Returns a scene with a box in front of a wall, in motion between its views, with noise and indirect light.
Scene box_before_a_wall() {
  RigModel rig = coaxial_rig();
  rig.camera = {132, 100, 200, 200, 65.5, 49.5, {}};
  rig.projector_from_camera.translation = {-0.3, 0, 0};
  rig.sensor.dsnu_electrons = 20;
  rig.camera_lens.blur_px = 0.5;
  rig.timing.exposure_s = 0.5 / (white_electrons_at_1m(rig) / rig.timing.exposure_s / 40000);
  Scene scene = world_of({grey_object(plane_mesh(3, 3), {Eigen::Matrix3d::Identity(), {0, 0, 1}}),
                          grey_object(box_mesh({0.2, 0.2, 0.1}), {Eigen::Matrix3d::Identity(), {0.1, 0, 0.8}}, 0.3)},
                         rig);
  scene.seed = 5;
  scene.bounces = 1;
  scene.ambient_lux = 200;
  scene.patterns = phase_shift_sequence(rig.projector.width, rig.projector.height, {129, 16}, 3, Axis::columns, 8);
  return scene;
}

double mean_of(const cv::Mat& image) { return cv::mean(image)[0]; }

// Cuts off the upper and lower edges of the beam, which meet the same rows from all poses.
cv::Mat without_border_rows(const cv::Mat& image) {
  const int border = image.rows / 10;
  return image.rowRange(border, image.rows - border);
}

// Poses that move edges of surfaces, shadows and the beam evenly across the pixels: a low-discrepancy set.
std::vector<Pose> shifted_poses() {
  std::vector<Pose> poses;
  for (int i = 0; i < 32; ++i) {
    const auto within = [&](double range_m, double step) { return range_m * std::fmod(step * i, 1); };
    poses.push_back({Eigen::Matrix3d::Identity(), {within(0.06, 0.8192), within(0.06, 0.6710), within(0.1, 0.5497)}});
  }
  return poses;
}

TEST(SensorView, TheFullImageIsTheOneThatTheRigCaptures) {
  const Scene scene = box_before_a_wall();
  const FringeStack stack = *VirtualRig(scene, {}).capture(scene.patterns);
  SensorView view(scene);
  for (const size_t pattern : {size_t{0}, size_t{4}}) {
    const cv::Mat image = view.image(scene.trajectory[0].world_from_robot, pattern, false);
    EXPECT_EQ(cv::norm(image, stack.images[pattern], cv::NORM_INF), 0) << pattern;
  }
}

TEST(SensorView, WithAutomaticExposureToo) {
  Scene scene = box_before_a_wall();
  scene.auto_exposure = true;
  scene.rig.timing.exposure_s *= 0.1;  // ignored
  const FringeStack stack = *VirtualRig(scene, {}).capture(scene.patterns);
  const cv::Mat image = SensorView(scene).image({}, 0, false);
  // The brightest pixel of a stack may be slightly darker than white.
  EXPECT_NEAR(mean_of(image) / mean_of(stack.images[0]), 1, 0.05);
}

TEST(SensorView, TheReducedImageIsAsBrightAsTheFullOneAndShowsTheSame) {
  const Scene scene = box_before_a_wall();
  SensorView view(scene);
  const Pose pose{Eigen::Matrix3d::Identity(), {0.05, -0.02, 0.1}};
  const cv::Mat full = view.image(pose, std::nullopt, false), reduced = view.image(pose, std::nullopt, true);
  EXPECT_EQ(reduced.size(), cv::Size(33, 25));
  double bright = 0, reduced_bright = 0;
  for (const Pose& shifted : shifted_poses()) {
    bright += mean_of(without_border_rows(view.image(shifted, std::nullopt, false)));
    reduced_bright += mean_of(without_border_rows(view.image(shifted, std::nullopt, true)));
  }
  EXPECT_NEAR(reduced_bright / bright, 1, 0.01);
  double difference = 0;
  for (int row = 0; row < reduced.rows; ++row) {
    for (int col = 0; col < reduced.cols; ++col)
      difference += std::abs(reduced.at<uchar>(row, col) - mean_of(full(cv::Rect(4 * col, 4 * row, 4, 4))));
  }
  EXPECT_LT(difference / static_cast<double>(reduced.total()), 0.05 * mean_of(full));
  const TruthFrame truth = view.truth(pose, false), reduced_truth = view.truth(pose, true);
  EXPECT_NEAR(static_cast<double>(reduced_truth.depth_m(2, 2)), 0.9, 1e-6);
  EXPECT_NEAR(static_cast<double>(truth.depth_m(8, 8)), 0.9, 1e-6);
  EXPECT_NEAR(cv::mean(reduced_truth.depth_m)[0], cv::mean(truth.depth_m)[0], 0.005);
}

TEST(SensorView, GroundTruthIsThatOfTheRig) {
  const Scene scene = box_before_a_wall();
  const TruthFrame expected = VirtualRig(scene, {}).truth_of(0), truth = SensorView(scene).truth({}, false);
  EXPECT_EQ(cv::norm(truth.depth_m, expected.depth_m, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(truth.mask, expected.mask, cv::NORM_INF), 0);
}

TEST(SensorView, StopsBetweenRowsOfBlocks) {
  const Scene scene = box_before_a_wall();
  SensorView view(scene);
  constexpr int kBlocksDown = 25;  // of 4 px
  std::atomic<int> asked = 0;
  EXPECT_FALSE(view.image({}, std::nullopt, false, [&] { return ++asked, false; }).empty());
  EXPECT_EQ(asked, kBlocksDown);
  asked = 0;
  EXPECT_TRUE(view.image({}, std::nullopt, false, [&] { return ++asked > 3; }).empty());
  EXPECT_LT(asked, kBlocksDown);
  asked = 0;
  EXPECT_TRUE(view.truth({}, false, [&] { return ++asked > 3; }).depth_m.empty());
  EXPECT_LT(asked, kBlocksDown);
}

TEST(SensorView, APatternThatIsNotThereIsRefused) {
  const Scene scene = box_before_a_wall();
  EXPECT_THROW(SensorView(scene).image({}, 6, true), std::out_of_range);
}

TEST(SensorView, AStackSamplesTheFullImages) {
  Scene scene = box_before_a_wall();
  scene.rig.camera_lens.blur_px = 0;  // which samples of the images leave out
  const SimulatedView full = *VirtualRig(scene, {.noise = false}).simulate(scene.patterns);
  SensorView view(scene);
  const SensorView::Stack stack = *view.stack(scene.trajectory[0]);
  ASSERT_EQ(stack.stack.images.size(), full.stack.images.size());
  EXPECT_EQ(stack.stack.images[0].size(), cv::Size(33, 25));
  EXPECT_EQ(stack.stack.exposure_time_s, full.stack.exposure_time_s);
  for (size_t i = 0; i < full.stack.images.size(); ++i) {
    EXPECT_EQ(stack.stack.exposure_s[i], full.stack.exposure_s[i]);
    EXPECT_NEAR(mean_of(stack.stack.images[i]) / mean_of(full.stack.images[i]), 1, 0.1) << i;
  }
  // Pixels at edges are as frequent as in the full images, not four times as frequent.
  const auto mixed = [](const TruthFrame& truth) {
    const auto is_mixed = [](float mask) { return (static_cast<int>(mask) & kTruthMixed) != 0; };
    const cv::Mat1f mask = without_border_rows(truth.mask);
    return static_cast<double>(std::count_if(mask.begin(), mask.end(), is_mixed)) / static_cast<double>(mask.total());
  };
  double at_full = 0, at_sample = 0, at_reduced = 0;
  for (const Pose& shifted : shifted_poses()) {
    at_full += mixed(view.truth(shifted, false)), at_reduced += mixed(view.truth(shifted, true));
    at_sample += mixed(view.stack({0, shifted})->truth);
  }
  EXPECT_NEAR(at_sample / at_full, 1, 0.2);
  EXPECT_GT(at_reduced / at_full, 2);
  EXPECT_FALSE(view.stack(scene.trajectory[0], [] { return true; }));
}

}  // namespace
}  // namespace fringeslam::sim
