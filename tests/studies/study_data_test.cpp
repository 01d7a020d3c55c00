// SPDX-License-Identifier: Apache-2.0
// The data of a study's page, from synthetic results. The page itself is tested in a browser: tests/report.
#include "tools/report/study_data.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "bench/studies/trial_run.h"
#include "tests/studies/study_files.h"
#include "tests/support/matchers.h"
#include "tools/report/picture_workers.h"

namespace fringeslam::tools {
namespace {

using namespace studies;
using nlohmann::json;
using support::error_of;
using testing::HasSubstr;
using testing::IsEmpty;

// Six trials: errors of 1, 2, 3 and 4 mm, the last beyond the limit; one is lost, one was killed.
class StudyData : public testing::Test {
 protected:
  StudyData() : study_(read_study(test::write_study(temp_.path()))) {
    for (int trial = 0; trial < 4; ++trial) {
      const bool good = trial < 3;
      add(trial, good ? Outcome::success : Outcome::inaccurate, good ? "" : "too_dark",
          {{"translation_mm", trial + 1.0}, {"rotation_deg", 0.1 * (trial + 1)}});
    }
    add(4, Outcome::lost, "too_dark", {{"translation_mm", std::nan("")}});
    add(5, Outcome::crashed, "crashed", {});
  }
  void add(int trial, Outcome outcome, const std::string& cause,
           const std::vector<std::pair<std::string, double>>& metrics) {
    lines_[trial] = to_line(study_, trial_of(study_, trial), {trial, outcome, cause, "", metrics});
  }
  json data(const StudyLimits& limits = {}, const std::map<int, nlohmann::ordered_json>& pictures = {}) const {
    const Summary summary = summarise(study_, lines_);
    return study_data(study_, rows_of(study_, lines_), summary, pictured_trials(summary, 3), pictures, limits);
  }

  test::TempFolder temp_;
  Study study_;
  std::map<int, std::string> lines_;
};

TEST_F(StudyData, CountsAndNames) {
  const json page = data();
  EXPECT_EQ(page["name"], "small");
  EXPECT_EQ(page["seed"], "5");
  EXPECT_EQ(page["hash"], hash_text(study_));
  EXPECT_EQ(page["scene"], "scene.yaml");
  EXPECT_EQ(page["planned"], 6);
  EXPECT_EQ(page["rule"], json({{"max_translation_mm", 5.0},
                                {"max_rotation_deg", 1.0},
                                {"min_valid", 0.0},
                                {"max_depth_mm", 1e4},
                                {"max_wrong_order", 1.0},
                                {"max_beyond_4_sigma", 1.0}}));
  EXPECT_EQ(page["summary"]["successes"], 3);
  EXPECT_EQ(page["summary"]["causes"], json({{"crashed", 1}, {"too_dark", 2}}));
  // Wilson interval of 3 of 6, by hand: (0.5 + z^2/12 -+ z sqrt(1/24 + z^2/144)) / (1 + z^2/6), z = 1.96.
  EXPECT_NEAR(page["summary"]["success_95"][0], 0.18761, 1e-5);
  EXPECT_NEAR(page["summary"]["success_95"][1], 0.81239, 1e-5);
}

TEST_F(StudyData, ParametersSayWhatIsDrawn) {
  const json parameters = data()["parameters"];
  ASSERT_EQ(parameters.size(), 2u);
  EXPECT_EQ(parameters[0]["name"], "light.ambient_lux");
  EXPECT_EQ(parameters[0]["logarithmic"], true);
  EXPECT_EQ(parameters[0]["low"], 10);
  EXPECT_EQ(parameters[0]["high"], 5000);
  EXPECT_EQ(parameters[1]["law"], "grid");
  EXPECT_EQ(parameters[1]["values"], json({"2", "4"}));
  EXPECT_TRUE(parameters[1]["low"].is_null());
}

TEST_F(StudyData, CurvesRiseByEachTrial) {
  const json curve = data()["curves"]["translation_mm"];
  EXPECT_EQ(curve["count"], 4);
  EXPECT_EQ(curve["none"], 2);
  EXPECT_EQ(curve["points"], json({{1.0, 0.25}, {2.0, 0.5}, {3.0, 0.75}, {4.0, 1.0}}));
  EXPECT_EQ(curve["percentiles"], json({{50.0, 2.5}, {90.0, 3.7}, {99.0, 3.97}}));
  EXPECT_EQ(data({.curve_points = 2})["curves"]["rotation_deg"]["points"], json({{0.2, 0.5}, {0.4, 1.0}}));
}

TEST_F(StudyData, TrialsAreColumns) {
  const json trials = data()["trials"];
  EXPECT_EQ(trials["every"], 1);
  EXPECT_EQ(trials["trial"], json({0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(trials["outcomes"], json({"crashed", "inaccurate", "lost", "success"}));
  EXPECT_EQ(trials["outcome"], json({3, 3, 3, 1, 2, 0}));
  EXPECT_EQ(trials["causes"], json({"crashed", "too_dark"}));
  EXPECT_EQ(trials["cause"], json({-1, -1, -1, 1, 1, 0}));
  EXPECT_EQ(trials["translation_mm"], json({1.0, 2.0, 3.0, 4.0, nullptr, nullptr}));
  ASSERT_EQ(trials["values"].size(), 2u);
  EXPECT_NEAR(trials["values"][0][3], std::stod(trial_of(study_, 3).values[0]), 0.01);
  EXPECT_EQ(trials["values"][1], json({0, 1, 0, 1, 0, 1}));  // a grid is cycled through
}

TEST_F(StudyData, OfManyTrialsSomeAreShownAndThoseWithPictures) {
  const json trials = data({.trials = 2})["trials"];
  EXPECT_EQ(trials["every"], 3);
  EXPECT_EQ(trials["trial"], json({0, 3, 4, 5}));  // every third, and the worst
}

TEST_F(StudyData, TheWorstOfEachCauseComeFirst) {
  const json worst =
      data({}, {{5, {{"unpictured", "killed"}}}, {3, {{"limit_mm", 1}, {"views", json::array()}}}})["worst"];
  ASSERT_EQ(worst.size(), 3u);
  EXPECT_EQ(worst[0]["trial"], 5);
  EXPECT_EQ(worst[0]["unpictured"], "killed");
  EXPECT_TRUE(worst[0]["translation_mm"].is_null());
  EXPECT_EQ(worst[1]["trial"], 3);
  EXPECT_EQ(worst[1]["translation_mm"], 4);
  EXPECT_EQ(worst[1]["limit_mm"], 1);
  EXPECT_EQ(worst[2]["trial"], 4);
  EXPECT_FALSE(worst[2].contains("views"));
  EXPECT_THAT(worst[1]["command"].get<std::string>(),
              HasSubstr("--seed " + std::to_string(trial_of(study_, 3).world_seed)));
  EXPECT_THAT(pictured_trials(summarise(study_, lines_), 0), IsEmpty());
}

TEST_F(StudyData, ReplaysByAShellsWords) {
  study_.file = "a 'study'.yaml";
  EXPECT_EQ(data()["replay"], "fringeslam study replay 'a '\\''study'\\''.yaml' --trial ");
}

TEST_F(StudyData, OfNoTrialsIsEmpty) {
  lines_.clear();
  const json page = data();
  EXPECT_EQ(page["summary"]["missing"], 6);
  EXPECT_THAT(page["trials"]["trial"], IsEmpty());
  EXPECT_THAT(page["curves"]["translation_mm"]["points"], IsEmpty());
  EXPECT_THAT(page["worst"], IsEmpty());
}

TEST_F(StudyData, APictureThatCrashesIsSaidInWords) {
  const Summary summary = summarise(study_, lines_);
  const auto pictured = [&](const std::string& script) {
    return pictures_of(study_, {summary.worst_of_causes.back()}, {1, {"sh", "-c", script}}, [] { return false; });
  };
  EXPECT_EQ(pictured("read trial; echo '{\"views\":[]}'").at(3), json({{"views", json::array()}}));
  EXPECT_THAT(pictured("read trial; kill -SEGV $$").at(3)["unpictured"].get<std::string>(),
              HasSubstr("Segmentation fault"));
  EXPECT_THAT(pictured("read trial; echo nonsense").at(3)["unpictured"].get<std::string>(),
              HasSubstr("without an answer"));
  EXPECT_THAT(error_of([&] {
                pictures_of(study_, summary.worst, {1, {"sh", "-c", "read trial; sleep 9"}}, [] { return true; });
              }),
              HasSubstr("interrupted"));
  // Trials that timed out are not run again.
  WorstTrial slow = summary.worst.front();
  slow.outcome = "timed_out";
  EXPECT_THAT(
      pictures_of(study_, {slow}, {1, {"false"}}, [] { return false; }).at(slow.trial)["unpictured"].get<std::string>(),
      HasSubstr("timed out"));
}

}  // namespace
}  // namespace fringeslam::tools
