// SPDX-License-Identifier: Apache-2.0
// fringeslam patterns: the pixels of the files agree with patterns.yaml.
#include <gmock/gmock.h>

#include "core/io/files.h"
#include "core/io/yaml.h"
#include "core/patterns/micro_code.h"
#include "core/patterns/patterns.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

class Patterns : public testing::Test {
 protected:
  std::string out() const { return (temp_ / "out").string(); }
  void write(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"patterns", "--out", out()});
    run_successfully(arguments);
  }
  void expect_refused(std::vector<std::string> arguments, const std::string& says) const {
    arguments.insert(arguments.begin(), {"patterns", "--out", out()});
    const test::Finished finished = run_program(arguments);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_THAT(finished.err, HasSubstr(says));
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_EQ(test::listing(temp_.path()).count("out"), 0U);
  }
  PatternSequence sequence() const { return read_patterns(temp_ / "out/patterns.yaml"); }
  cv::Mat image(const std::string& name) const { return read_grey(temp_ / ("out/" + name)); }

  test::TempFolder temp_;
};

// Returns the level of a pixel, 0 to 1, before quantization.
double wanted(const Pattern& pattern, int row, int col) {
  return ideal_intensity(pattern, pattern.axis == Axis::columns ? col : row);
}

std::string number(size_t i) { return std::string(i < 10 ? "00" : "0") + std::to_string(i) + ".png"; }

TEST_F(Patterns, PixelsOfTheFilesAreTheIdealIntensities) {
  write({"--size", "64x48", "--periods", "16,10.5", "--steps", "4", "--axis", "both", "--gray", "complementary",
         "--gray-inverted", "--white-black", "--ramp-levels", "5"});
  const PatternSequence written = sequence();
  EXPECT_EQ(written.width, 64);
  EXPECT_EQ(written.height, 48);
  // 2 axes x 2 periods x 4 steps; Gray code of 5.25 px cells: 4 bits per axis, twice; white, black; the ramp.
  ASSERT_EQ(written.patterns.size(), 16U + 2 * (4 + 4) + 2 + 5);
  for (size_t i = 0; i < written.patterns.size(); ++i) {
    const cv::Mat1b pixels = image(number(i));
    ASSERT_EQ(pixels.size(), cv::Size(64, 48));
    for (int row = 0; row < 48; ++row) {
      for (int col = 0; col < 64; ++col)
        ASSERT_NEAR(pixels(row, col), 255 * wanted(written.patterns[i], row, col), 0.5 + 1e-3) << i;
    }
  }
}

TEST_F(Patterns, ExtraPeriodsAndProductsAreWritten) {
  write({"--size", "64x48", "--periods", "16", "--extra-periods", "21.1,20.3", "--product-periods", "32", "--carrier",
         "8", "--axis", "both"});
  const PatternSequence written = sequence();
  ASSERT_EQ(written.patterns.size(), 2 * (3 + 2 + 9U));
  EXPECT_EQ(written.patterns[3].coding, Coding::extra);
  EXPECT_EQ(written.patterns[5].coding, Coding::product);
  for (size_t i = 0; i < written.patterns.size(); ++i) {
    const cv::Mat1b pixels = image(number(i));
    for (int row = 0; row < 48; ++row) {
      for (int col = 0; col < 64; ++col)
        ASSERT_NEAR(pixels(row, col), 255 * wanted(written.patterns[i], row, col), 0.5 + 1e-3) << i;
    }
  }
}

TEST_F(Patterns, OfMicroPhaseShiftingDistinguishAllOrders) {
  expect_refused({"--size", "1024x768", "--micro", "16.5", "--micro-images", "5", "--steps", "4"}, "at least 6 images");
  expect_refused({"--size", "1024x768", "--micro-images", "7"}, "micro_period_px");
  write({"--size", "1024x768", "--micro", "16.5", "--micro-images", "8", "--steps", "4"});
  const PatternSequence written = sequence();
  ASSERT_EQ(written.patterns.size(), 8U);
  std::vector<double> others;
  for (const Pattern& pattern : written.patterns) {
    if (pattern.coding == Coding::extra) others.push_back(pattern.period_px);
  }
  ASSERT_EQ(others.size(), 4U);
  EXPECT_GT(micro_code_distance(16.5, others, 1024).distance, 0.1);
}

TEST_F(Patterns, OfASceneMayBeExtraPeriodsAndProducts) {
  test::write_bytes(temp_ / "scene/scene.yaml",
                    test::replaced(test::kSmallScene, "  periods_px: [1040, 131, 16.5]",
                                   "  extra_periods_px: [21.1]\n  product_periods_px: [64, 32]\n  carrier_px: 16"));
  test::write_bytes(temp_ / "scene/rig.yaml", to_yaml(test::thesis_rig_reduced(2)));
  write({"--scene", (temp_ / "scene").string()});
  ASSERT_EQ(sequence().patterns.size(), 1 + 2 * 9U);
  EXPECT_EQ(sequence().patterns[0], (Pattern{Axis::columns, 21.1, 0, 8, Coding::extra}));
  EXPECT_EQ(sequence().patterns[10].period_px, 32);
}

TEST_F(Patterns, MoreThanEightBitsAreSixteenBitFiles) {
  write({"--size", "40x4", "--periods", "40", "--bits", "10"});
  const cv::Mat1w pixels = image("001.png");
  const Pattern pattern = sequence().patterns[1];
  for (int col = 0; col < 40; ++col)
    EXPECT_EQ(pixels(0, col), std::round(65535 * std::round(1023 * ideal_intensity(pattern, col)) / 1023));
}

TEST_F(Patterns, LinearisedPatternsUndoTheRigsResponse) {
  RigModel rig = test::thesis_rig_reduced(2);
  rig.projector.width = 64, rig.projector.height = 8;
  rig.projector.fx /= 16, rig.projector.fy /= 96, rig.projector.cx = 31.5, rig.projector.cy = 3.5;
  for (int i = 0; i <= 64; ++i) rig.projector_response.push_back(std::pow(i / 64.0, 2.2));
  test::write_bytes(temp_ / "rig.yaml", to_yaml(rig));
  write({"--rig", (temp_ / "rig.yaml").string(), "--periods", "32", "--linearise"});
  const cv::Mat1b pixels = image("000.png");
  const Pattern pattern = sequence().patterns[0];
  for (int col = 0; col < 64; ++col) {
    const double light = interpolate_table(rig.projector_response, pixels(0, col) / 255.0);
    EXPECT_NEAR(light, ideal_intensity(pattern, col), 2.2 / 255 + 1e-3)
        << "tolerance: half a level at the steepest slope, and the table's interpolation";
  }
}

TEST_F(Patterns, PackedImagesHoldThreePatternsInTheOrderAsked) {
  const std::vector<std::string> design = {"--size", "64x8", "--periods", "64,16"};
  write(design);
  std::vector<cv::Mat> grey;
  for (size_t i = 0; i < 6; ++i) grey.push_back(image(number(i)));
  for (const std::string order : {"RGB", "GBR"}) {
    std::vector<std::string> arguments = design;
    arguments.insert(arguments.end(), {"--pack", order});
    write(arguments);
    EXPECT_EQ(test::listing(temp_ / "out"),
              (std::set<std::string>{".fringeslam", "packed", "packed/000.png", "packed/001.png", "patterns.yaml",
                                     "projection.yaml"}));
    const YamlMap projection = YamlMap::load(temp_ / "out/projection.yaml");
    EXPECT_EQ(projection.text("packing"), order);
    for (const YamlMap& entry : projection.maps("images")) {
      for (const auto& [channel, from] :
           {std::pair("R", GreyFrom::red), std::pair("G", GreyFrom::green), std::pair("B", GreyFrom::blue)}) {
        const cv::Mat packed = read_as_grey(entry.path("file"), from);
        const auto pattern = static_cast<size_t>(entry.integer(channel, {0, 5}));
        EXPECT_EQ(cv::norm(packed, grey[pattern], cv::NORM_INF), 0) << order << " " << channel;
        EXPECT_EQ(pattern % 3, order.find(channel)) << order;
      }
    }
  }
}

TEST_F(Patterns, OfASceneAreTheScenes) {
  test::write_small_scene(temp_ / "scene");
  write({"--scene", (temp_ / "scene").string()});
  const PatternSequence wanted = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  EXPECT_TRUE(sequence() == wanted);
}

TEST_F(Patterns, BadOptionsAreRefused) {
  const std::string periods = "--periods";
  expect_refused({periods, "16"}, "--size");
  expect_refused({"--size", "64", periods, "16"}, "WIDTHxHEIGHT");
  expect_refused({"--size", "64x-2", periods, "16"}, "WIDTHxHEIGHT");
  expect_refused({"--size", "64x48", "--rig", "rig.yaml", periods, "16"}, "excludes");
  expect_refused({"--size", "64x48", periods, "16", "--linearise"}, "needs --rig");
  expect_refused({"--size", "64x48"}, "the sequence is empty");
  expect_refused({"--size", "64x48", "--product-periods", "16"}, "is missing; add carrier_px");
  expect_refused({"--size", "64x48", periods, "16", "--carrier", "8"}, "there are none; add product_periods_px");
  expect_refused({"--size", "64x48", "--extra-periods", "1"}, "--extra-periods");
  expect_refused({"--size", "64x48", "--gray", "plain"}, "a Gray code numbers fringe periods");
  expect_refused({"--size", "64x48", periods, "16", "--steps", "2"}, "--steps");
  expect_refused({"--size", "64x48", periods, "1"}, "--periods");
  expect_refused({"--size", "64x48", periods, "16", "--steps", "4", "--pack", "RGB"},
                 "there are 4; use a multiple of 3");
  expect_refused({"--size", "64x48", periods, "16", "--pack", "RGR"}, "--pack");
  expect_refused({"--size", "64x48", periods, "16", "--bits", "10", "--pack", "RGB"}, "8 bits");
  expect_refused({"--rig", (temp_ / "none.yaml").string(), periods, "16"}, "none.yaml: cannot be opened");
  test::write_bytes(temp_ / "rig.yaml", to_yaml(test::thesis_rig()));
  expect_refused({"--rig", (temp_ / "rig.yaml").string(), periods, "16", "--linearise"}, "no projector response");
}

}  // namespace
}  // namespace fringeslam
