// SPDX-License-Identifier: Apache-2.0
// fringeslam advise: the advice follows from the images and holds against the ground truth of rendered scenes.
#include <gmock/gmock.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

const std::string kThreePeriods = "patterns={axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}";

std::string scene(const std::string& name) {
  return (test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes" / name / "scene.yaml").string();
}

json advice_on(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "advise");
  arguments.push_back("--json");
  return json::parse(run_successfully(arguments).out);
}

TEST(AdviseVerb, BrightAndDarkPartsNeedTwoExposuresAndThenHaveDepth) {
  const json document = advice_on({scene("metal_card_rubber"), "--with", kThreePeriods});
  EXPECT_EQ(document["advice"]["exposures"].size(), 2U);
  EXPECT_EQ(document["indirect"], "none");
  EXPECT_EQ(document["motion"], "none");
  const json& check = document["check"];
  EXPECT_LT(check["present"]["valid"], 0.98);
  EXPECT_GE(check["advised"]["valid"], 0.99);
  EXPECT_LT(check["advised"]["beyond_4_sigma"], 1e-3);
}

// The path lasts for the present images only, not for the longer ones of the advice.
TEST(AdviseVerb, AdviceLongerThanThePathIsNotChecked) {
  const std::string path =
      "trajectory={motions: [{translation_mm: [0.6, 0, 0], rotation_deg: [0, 0, 0]}], continuous: {speed_m_s: 0.002, "
      "acceleration_m_s2: 10}}";
  const std::vector<std::string> words = {
      "advise", scene("metal_card_rubber"), "--with", kThreePeriods, "--with", path, "--views", "1"};
  const test::Finished text = run_successfully(words);
  EXPECT_THAT(text.out, HasSubstr("the advised patterns are not checked: the path is too short for them"));
  const json document = advice_on({words.begin() + 1, words.end()});
  EXPECT_EQ(document["advice"]["exposures"].size(), 2U);
  EXPECT_TRUE(document["check"].contains("present"));
  EXPECT_FALSE(document["check"].contains("advised"));
}

// 63 % of the pixels are saturated, and how much is visible in another look only.
TEST(AdviseVerb, SaturatedSceneIsLookedAtAgain) {
  const json document = advice_on({scene("metal_card_rubber"), "--with", kThreePeriods, "--with",
                                   "light.auto_exposure=false", "--with", "light.exposure_s=0.02"});
  EXPECT_EQ(document["looks"].size(), 1U);
  EXPECT_LT(document["looks"][0], 1);
  EXPECT_TRUE(document["advice"]["look_first"].is_null());
  EXPECT_LT(document["check"]["present"]["valid"], 0.5);
  EXPECT_GE(document["check"]["advised"]["valid"], 0.99);
}

TEST(AdviseVerb, FlatBoardNeedsNeitherExposuresNorMicroPhaseShifting) {
  const json document = advice_on({scene("flat_board")});
  EXPECT_EQ(document["advice"]["exposures"].size(), 1U);
  EXPECT_EQ(document["advice"]["coding"]["name"], "multifrequency");
  EXPECT_LE(document["advice"]["images"], 9);
  EXPECT_GE(document["check"]["advised"]["valid"], 0.99);
  EXPECT_LT(document["check"]["advised"]["beyond_4_sigma"], 1e-3);
}

// With the scene's own micro phase shifting, which hides indirect light, a further look shows it.
TEST(AdviseVerb, GrooveNeedsMicroPhaseShifting) {
  const json three = advice_on({scene("groove_90"), "--with", kThreePeriods}),
             own = advice_on({scene("groove_90"), "--no-check"});
  for (const json& document : {three, own}) {
    EXPECT_EQ(document["indirect"], "present");
    EXPECT_EQ(document["advice"]["coding"]["name"], "micro");
  }
  EXPECT_FALSE(three["tested_periods"]);
  EXPECT_TRUE(own["tested_periods"]);
  EXPECT_FALSE(own.contains("check"));
  EXPECT_GE(three["check"]["advised"]["valid"], 0.99);
  EXPECT_LT(three["check"]["present"]["valid"], 0.1);
}

// A strongly nonlinear projector is named, not mistaken for indirect light.
TEST(AdviseVerb, NonlinearProjectorMustBeCalibratedFirst) {
  const json document = advice_on({scene("flat_board"), "--no-check", "--with", "rig.file=../rigs/gamma.yaml"});
  EXPECT_TRUE(document["nonlinear"]);
  EXPECT_EQ(document["indirect"], "unknown");
  EXPECT_THAT(document["warnings"].dump(), HasSubstr("calibrate response"));
}

TEST(AdviseVerb, MotionIsNotMistakenForIndirectLight) {
  const json document = advice_on(
      {scene("boxes_and_foam"), "--no-check", "--views", "1", "--with", "trajectory.continuous.speed_m_s=0.3"});
  EXPECT_EQ(document["motion"], "moving");
  EXPECT_EQ(document["indirect"], "unknown");
  EXPECT_EQ(document["advice"]["exposures"], json({1.0}));
}

// A recording gives the advice of its scene, with and without its ground truth; the advised command works.
TEST(AdviseVerb, DatasetIsJudgedByItsImagesAlone) {
  const test::TempFolder temp;
  test::write_small_scene(temp.path());
  const std::string data = (temp / "data").string();
  run_successfully({"render", (temp / "scene.yaml").string(), "--out", data, "--quiet"});
  const json of_scene = advice_on({(temp / "scene.yaml").string(), "--no-check"}), with_truth = advice_on({data});
  test::fs::remove_all(temp / "data/truth");
  std::string info = test::read_bytes(temp / "data/dataset.yaml");
  test::write_bytes(temp / "data/dataset.yaml", test::replaced(info, "truth: true", "truth: false"));
  const json without_truth = advice_on({data});
  EXPECT_EQ(with_truth, without_truth);
  EXPECT_EQ(of_scene["views"], with_truth["views"]);
  EXPECT_EQ(of_scene["advice"]["exposures"], with_truth["advice"]["exposures"]);
  EXPECT_FALSE(with_truth.contains("check"));
  const test::Finished text = run_successfully({"advise", data});
  EXPECT_THAT(text.out, HasSubstr("what these images cannot show"));
  const std::string command = with_truth["advice"]["commands"][0];
  ASSERT_THAT(command, HasSubstr("fringeslam patterns --size 1024x768"));
}

TEST(AdviseVerb, BadInputIsRefusedInOneLine) {
  const test::TempFolder temp;
  test::write_small_scene(temp.path());
  const std::string data = (temp / "data").string(), file = (temp / "scene.yaml").string();
  const auto expect_refused = [&](std::vector<std::string> arguments, const std::string& says) {
    arguments.insert(arguments.begin(), "advise");
    arguments.push_back("--quiet");
    const test::Finished finished = run_program(arguments);
    EXPECT_EQ(finished.exit_code, 2) << says;
    EXPECT_THAT(finished.err, HasSubstr(says));
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_EQ(finished.out, "");
  };
  expect_refused({(temp / "nothing").string()}, "nothing");
  expect_refused({file, "--views", "0"}, "--views");
  expect_refused({file, "--set", "advice.covered=2"}, "advice.covered");
  expect_refused({file, "--set", "advise.covered=1"}, "did you mean 'advice'");
  expect_refused({file, "--with", "patterns={axis: columns, gray_cell_px: 8}"}, "white and a black image");
  expect_refused({file, "--with", "patterns={axis: columns, ramp_levels: 4}"}, "code neither columns nor rows");
  run_successfully({"render", file, "--out", data, "--quiet"});
  expect_refused({data, "--seed", "3"}, "--seed and --with have no effect");
}

}  // namespace
}  // namespace fringeslam
