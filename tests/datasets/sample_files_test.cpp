// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/sample_files.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "bench/datasets/trial_part.h"
#include "bench/studies/trial_settings.h"
#include "core/depth/depth.h"
#include "core/io/files.h"
#include "tests/datasets/dataset_files.h"

namespace fringeslam::datasets {
namespace {

// The first view of a trial of the small dataset, and its files.
class SampleFiles : public testing::Test {
 protected:
  void SetUp() override {
    spec_ = read_spec(test::write_dataset(temp_.path()));
    trial_ = studies::trial_of(spec_, 0);
    scene_ = scene_of(spec_, trial_);
    rig_ = std::make_unique<sim::VirtualRig>(scene_, sim::RenderOptions{});
    rays_ = pixel_rays(scene_.rig.camera);
    view_ = *rig_->simulate(scene_.patterns);
  }
  std::map<std::string, std::string> files(const Spec& spec) const {
    std::map<std::string, std::string> found;
    for (SampleFile& file : sample_files({spec, trial_, scene_, rig_->model(), rays_, {}}, view_, 0))
      found[file.extension] = std::move(file.bytes);
    return found;
  }

  test::TempFolder temp_;
  Spec spec_;
  studies::Trial trial_;
  sim::Scene scene_;
  std::unique_ptr<sim::VirtualRig> rig_;
  PixelRays rays_;
  sim::SimulatedView view_;
};

TEST_F(SampleFiles, OfATrialWhoseRigHasDisappearedAreNotRefused) {
  test::fs::rename(temp_ / "rig.yaml", temp_ / "moved.yaml");
  EXPECT_THAT(test::message_of([&] { (void)write_trial(spec_, trial_, temp_ / "parts"); }),
              testing::HasSubstr("rig.yaml"));
  EXPECT_FALSE(read_trial(temp_ / "parts", 0));
  test::fs::rename(temp_ / "moved.yaml", temp_ / "rig.yaml");
  const TrialIndex index = write_trial(spec_, trial_, temp_ / "parts");
  EXPECT_EQ(index.samples.size(), 2);
  EXPECT_EQ(index.refused, "");
}

bool equal(const cv::Mat1f& a, const cv::Mat1f& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](float x, float y) {
           return x == y || (std::isnan(x) && std::isnan(y));
         });
}

TEST_F(SampleFiles, HoldTheImagesAndTheTruthWithoutLoss) {
  const auto found = files(spec_);
  for (size_t i = 0; i < view_.stack.images.size(); ++i) {
    const DecodedImage image = decode_image(found.at("image.00" + std::to_string(i) + ".png"), "image");
    EXPECT_EQ(cv::norm(image.image, view_.stack.images[i], cv::NORM_INF), 0);
  }
  EXPECT_TRUE(equal(decode_image(found.at("depth.exr"), "depth").image, view_.truth.depth_m));
  const DecodedImage coordinate = decode_image(found.at("coordinate.exr"), "coordinate");
  EXPECT_EQ(coordinate.channels, (std::vector<std::string>{"projector_column", "projector_row"}));
  std::vector<cv::Mat1f> planes;
  cv::split(coordinate.image, planes);
  EXPECT_TRUE(equal(planes[0], view_.truth.projector_column));
  EXPECT_TRUE(equal(planes[1], view_.truth.projector_row));
  EXPECT_FALSE(found.contains("phase.exr"));
  EXPECT_FALSE(found.contains("thermal.png"));
}

TEST_F(SampleFiles, ContainOnlyTheSelectedParts) {
  Spec spec = spec_;
  spec.parts = {Part::depth, Part::phase};
  const auto found = files(spec);
  std::vector<std::string> names;
  for (const auto& [name, bytes] : found) names.push_back(name);
  EXPECT_EQ(names, (std::vector<std::string>{"depth.exr", "json", "patterns.yaml", "phase.exr", "rig.yaml"}));
  // Phi = 2 pi (u + 1/2) / 16.5.
  const DecodedImage phase = decode_image(found.at("phase.exr"), "phase");
  ASSERT_EQ(phase.channels, (std::vector<std::string>{"phase.columns.16.5"}));
  const cv::Mat1f& column = view_.truth.projector_column;
  int compared = 0;
  for (int i = 0; i < static_cast<int>(column.total()); ++i) {
    const double u = column(i);
    if (std::isnan(u)) continue;
    ++compared;
    EXPECT_NEAR(cv::Mat1f(phase.image)(i), 2 * M_PI * (u + 0.5) / 16.5, 1e-4);
  }
  EXPECT_GT(compared, 1000);
}

TEST_F(SampleFiles, SigmaIsTheScatterDueToNoise) {
  const PredictedSigma sigma = predicted_sigma(view_, scene_.rig, rays_, {});
  EXPECT_TRUE(sigma.row_px.empty());
  sim::RenderOptions exact;
  exact.noise = exact.quantise = false;
  const FringeStack clean = *sim::VirtualRig(scene_, exact).capture(scene_.patterns);
  const DecodedStack noisy = decode(view_.stack, rig_->model(), {}), mean = decode(clean, rig_->model(), {});
  DepthOptions loose;
  loose.max_sigma_m = 1;
  const Frame noisy_frame = reconstruct(noisy, rig_->model(), rays_, loose),
              mean_frame = reconstruct(mean, rig_->model(), rays_, loose);
  std::vector<double> column, depth;
  int lit = 0, known = 0;
  for (int i = 0; i < static_cast<int>(sigma.column_px.total()); ++i) {
    if (static_cast<int>(view_.truth.mask(i)) != (kTruthSurface | kTruthInBeam)) continue;
    ++lit;
    known += !std::isnan(sigma.column_px(i)) && !std::isnan(sigma.depth_m(i));
    const double u = static_cast<double>(noisy.coordinate_px(i) - mean.coordinate_px(i));
    if (!std::isnan(u)) column.push_back(u / static_cast<double>(sigma.column_px(i)));
    const double z = static_cast<double>(noisy_frame.points_m(i)[2] - mean_frame.points_m(i)[2]);
    if (!std::isnan(z)) depth.push_back(z / static_cast<double>(sigma.depth_m(i)));
  }
  ASSERT_GT(lit, 2000);
  EXPECT_GT(known, 0.98 * lit);
  // Robust scatter in units of sigma: the median absolute deviation of a standard normal number is 0.6745. Its standard
  // error is 1.17 / sqrt(n), below 0.02 here.
  const auto scatter = [](std::vector<double> values) {
    for (double& value : values) value = std::abs(value);
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2] / 0.6745;
  };
  ASSERT_GT(column.size(), 4000u);
  ASSERT_GT(depth.size(), 4000u);
  EXPECT_NEAR(scatter(column), 1, 0.06);
  EXPECT_NEAR(scatter(depth), 1, 0.06);
}

TEST_F(SampleFiles, DamagedImagesAreErrors) {
  const auto found = files(spec_);
  for (const char* name : {"depth.exr", "image.000.png"}) {
    const std::string half = found.at(name).substr(0, found.at(name).size() / 2);
    EXPECT_THAT(test::message_of([&] { (void)decode_image(half, "half"); }), testing::StartsWith("half: "));
  }
  EXPECT_THAT(test::message_of([&] { (void)decode_image("no image", "text"); }), testing::StartsWith("text: "));
}

}  // namespace
}  // namespace fringeslam::datasets
