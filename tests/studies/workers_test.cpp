// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/workers.h"

#include <gmock/gmock.h>

#include "core/types/error.h"
#include "tests/studies/study_files.h"
#include "tests/support/matchers.h"

namespace fringeslam::studies {
namespace {

namespace fs = std::filesystem;
using support::error_of;
using testing::HasSubstr;

TEST(RunTrial, AMissingFileIsNotTheTrialsFault) {
  const test::TempFolder temp;
  const Study study = read_study(test::write_study(temp.path()));
  fs::rename(temp / "rig.yaml", temp / "moved.yaml");
  EXPECT_THAT(error_of([&] { (void)run_trial(study, trial_of(study, 1)); }), HasSubstr("rig.yaml"));
  fs::rename(temp / "moved.yaml", temp / "rig.yaml");
  EXPECT_NE(run_trial(study, trial_of(study, 1)).outcome, Outcome::refused);
}

// The worker is a script that answers each trial.
std::vector<int> answered_before(const std::string& script, std::string& error) {
  const test::TempFolder temp;
  const Study study = read_study(test::write_study(temp.path()));
  std::vector<int> answered;
  error = error_of([&] {
    const auto tell = [&](int trial, const std::string&) { answered.push_back(trial); };
    (void)run_trials(study, {0, 1, 2, 3}, {1, {"sh", "-c", script}}, tell, [] { return false; });
  });
  return answered;
}

TEST(RunTrials, EndAtAFailureOfTheMachine) {
  std::string error;
  const std::vector<int> answered =
      answered_before(R"(read n; echo '{}'; read n; echo '{"failed":"the disk is gone"}'; read n; echo '{}')", error);
  EXPECT_EQ(error, "trial 1: the disk is gone");
  EXPECT_EQ(answered, std::vector<int>{0});
}

TEST(RunTrials, EndIfWorkersCannotStart) {
  for (const char* script : {"exit 2", "exit 127"}) {
    std::string error;
    EXPECT_TRUE(answered_before(script, error).empty());
    EXPECT_THAT(error, HasSubstr("could not start"));
  }
}

TEST(RunTrials, GoOnAfterAWorkersDeath) {
  std::string error;
  EXPECT_EQ(answered_before("read n; exit 3", error), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(error, "no Error was thrown");
}

}  // namespace
}  // namespace fringeslam::studies
