// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "bench/evaluation/leaderboard.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using evaluation::Result;
using testing::HasSubstr;
using testing::Not;

class EvaluateVerb : public testing::Test {
 protected:
  EvaluateVerb() {
    test::write_small_scene(temp_ / "scene");
    test::write_bytes(temp_ / "suite.yaml", "datasets:\n  - {name: small, scene: scene, seeds: 2}\n");
  }

  std::vector<std::string> command(const std::string& system, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"evaluate", (temp_ / "suite.yaml").string(), "--with", system,
                                      "--out",    (temp_ / "out").string()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  std::vector<Result> evaluated(const std::string& system, const std::vector<std::string>& more = {}) const {
    test::run_successfully(command(system, more));
    return evaluation::read_results(temp_ / "out/results.jsonl");
  }
  test::TempFolder temp_;
  const std::string ours_ = test::quoted(FRINGESLAM_PROGRAM) + " run {dataset} --out {out} --no-report --quiet";
};

TEST_F(EvaluateVerb, ScoresOurProgramAsItScoresItself) {
  const std::vector<Result> results = evaluated(ours_, {"--name", "ours"});
  ASSERT_EQ(results.size(), 2);
  for (const Result& r : results) {
    EXPECT_EQ(r.end, "finished") << r.message;
    EXPECT_EQ(r.poses, 2);
    EXPECT_EQ(r.views, 2);
    EXPECT_LT(r.ate_m, 1e-4);
    EXPECT_GT(r.f_score, 0.9);
    EXPECT_GT(r.peak_mib, 10);
  }
  const auto direct =
      nlohmann::json::parse(test::run_successfully({"run", (temp_ / "scene").string(), "--seed", "1", "--out",
                                                    (temp_ / "direct").string(), "--no-report", "--json"})
                                .out);
  const double ate_mm = direct.at("score").at("trajectory").at("ate_rmse_mm");
  EXPECT_NEAR(1e3 * results[0].ate_origin_m, ate_mm, 1e-6);
  EXPECT_THAT(test::read_bytes(temp_ / "out/leaderboard.html"), HasSubstr("ours"));
}

TEST_F(EvaluateVerb, MessagesAreTheEndOfTheLog) {
  const std::pair<std::string, std::string> cases[] = {
      {"printf 'one\\ntwo\\n\\n'; exit 3; {dataset} {out}", "exit code 3: two"},
      {"head -c 100000 /dev/zero | tr '\\0' x; exit 1; {dataset} {out}", "exit code 1: " + std::string(200, 'x')},
      {"rm log.txt; mkfifo log.txt; exit 1; {dataset} {out}", "exit code 1: "},
      {"rm log.txt; ln -s /dev/zero log.txt; exit 1; {dataset} {out}", "exit code 1: "}};
  for (const auto& [system, message] : cases) {
    for (const Result& result : evaluated(system, {"--name", "failing"})) EXPECT_EQ(result.message, message) << system;
  }
}

TEST_F(EvaluateVerb, SuitesOfTheSameNameAreRefused) {
  test::write_bytes(temp_ / "other/suite.yaml", "datasets:\n  - {name: small, scene: ../scene, seeds: 1}\n");
  std::vector<std::string> words = command(ours_);
  words.insert(words.begin() + 1, (temp_ / "other/suite.yaml").string());
  const auto refused = test::run_program(words);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("another suite is called 'suite'"));
}

TEST_F(EvaluateVerb, SystemsDoNotSeeTheTruth) {
  evaluated("cp -r {dataset} {out}/seen; cp {dataset}/dataset.yaml {out}", {"--name", "copy"});
  const auto seen = temp_ / "out/outputs/copy/suite/small-1/out";
  EXPECT_TRUE(test::fs::exists(seen / "seen/stacks/000001/00.png"));
  for (const auto& entry : test::fs::recursive_directory_iterator(seen)) {
    const std::string name = entry.path().filename();
    EXPECT_THAT(name, Not(HasSubstr("truth"))) << entry.path();
    EXPECT_NE(name, "resolved_scene.yaml");
    EXPECT_NE(name, "stage.tum");
  }
  EXPECT_THAT(test::read_bytes(seen / "dataset.yaml"), HasSubstr("truth: false"));
}

TEST_F(EvaluateVerb, TheTruthItselfHasNoError) {
  const std::string truth = "cp {dataset}/../truth/truth/truth.tum {out}/trajectory.tum";
  for (const Result& r : evaluated(truth, {"--name", "oracle"})) EXPECT_LT(r.ate_m, 1e-12);
  const std::string rgbd = "cp {dataset}/../truth/groundtruth.txt {out}/trajectory.txt";
  for (const Result& r : evaluated(rgbd, {"--name", "oracle", "--format", "tum-rgbd"})) {
    EXPECT_LT(r.ate_m, 1e-9) << r.message;
    EXPECT_EQ(r.poses, 2);
  }
}

TEST_F(EvaluateVerb, FilesOfTheUserSurviveARepetition) {
  const std::string truth = "cp {dataset}/../truth/truth/truth.tum {out}/trajectory.tum; date +%N > {out}/nanoseconds";
  evaluated(truth, {"--name", "oracle"});
  const auto folder = temp_ / "out/outputs/oracle/suite/small-1";
  test::write_bytes(folder / "notes.txt", "mine");
  test::write_bytes(folder / "out/figure.txt", "mine, too");
  const std::string before = test::read_bytes(folder / "out/nanoseconds");
  evaluated(truth, {"--name", "oracle", "--again"});
  EXPECT_NE(test::read_bytes(folder / "out/nanoseconds"), before);
  EXPECT_EQ(test::read_bytes(folder / "notes.txt"), "mine");
  EXPECT_EQ(test::read_bytes(folder / "out/figure.txt"), "mine, too");
  EXPECT_FALSE(test::fs::exists(folder / "out/nanoseconds.kept"));
}

TEST_F(EvaluateVerb, FilesOfTheUserAreNotScored) {
  evaluated("true # {dataset} {out}", {"--name", "silent"});
  test::write_bytes(temp_ / "out/outputs/silent/suite/small-1/out/trajectory.tum", "0 0 0 0 0 0 0 1\n");
  for (const Result& r : evaluated("true # {dataset} {out}", {"--name", "silent", "--again"}))
    EXPECT_EQ(r.end, "no_trajectory");
  EXPECT_TRUE(test::fs::exists(temp_ / "out/outputs/silent/suite/small-1/out/trajectory.tum"));
}

TEST_F(EvaluateVerb, SystemsMayLeaveAnything) {
  const std::string remover = "folder=$(cd {out}/.. && pwd); cd /; rm -rf \"$folder\" # {dataset}";
  for (const Result& r : evaluated(remover, {"--name", "remover"})) EXPECT_EQ(r.end, "no_trajectory");
  const std::string messy =
      "cp {dataset}/../truth/truth/truth.tum {out}/trajectory.tum; mkdir .fringeslam closed; touch .fringeslam/a "
      "closed/b; mkfifo pipe; ln -s nowhere link; chmod 0 closed; chmod a-w {out} .";
  EXPECT_LT(evaluated(messy, {"--name", "messy"}).back().ate_m, 1e-12);
  EXPECT_TRUE(test::fs::exists(temp_ / "out/outputs/messy/suite/small-1/closed/b"));
}

TEST_F(EvaluateVerb, FailuresAreResults) {
  const std::pair<std::string, std::string> cases[] = {{"exit 4", "exit code 4"},
                                                       {"sleep 30", "longer than 0.5 s"},
                                                       {"true", "wrote no trajectory"},
                                                       {"echo 1 2 3 > {out}/trajectory.tum", "trajectory.tum:1"}};
  int system = 0;
  for (const auto& [what, message] : cases) {
    const std::string name = "system" + std::to_string(system++);
    const auto results = evaluated(what + " # {dataset} {out}", {"--name", name, "--timeout", "0.5"});
    EXPECT_EQ(results.size(), 2 * system);
    EXPECT_THAT(results.back().message, HasSubstr(message)) << what;
    EXPECT_FALSE(results.back().has_trajectory());
  }
  const std::string html = test::read_bytes(temp_ / "out/leaderboard.html");
  EXPECT_THAT(html, HasSubstr("exit code 4"));
}

TEST_F(EvaluateVerb, ADamagedMapLeavesTheTrajectorysScore) {
  const auto results = evaluated(
      "cp {dataset}/../truth/truth/truth.tum {out}/trajectory.tum; echo ply > {out}/map.ply # ", {"--name", "a"});
  EXPECT_LT(results[0].ate_m, 1e-12);
  EXPECT_THAT(results[0].message, HasSubstr("map.ply"));
  EXPECT_TRUE(std::isnan(results[0].f_score));
}

TEST_F(EvaluateVerb, ResultsOfTheSameCommandAreKept) {
  const std::string count = "echo x >> " + test::quoted((temp_ / "count").string()) + " # {dataset} {out}";
  evaluated(count, {"--name", "a"});
  evaluated(count, {"--name", "a"});
  EXPECT_EQ(test::read_bytes(temp_ / "count"), "x\nx\n");
  evaluated(count, {"--name", "a", "--again"});
  EXPECT_EQ(test::read_bytes(temp_ / "count"), "x\nx\nx\nx\n");
  evaluated(count + " ", {"--name", "a"});
  EXPECT_EQ(test::read_bytes(temp_ / "count").size(), 12);
}

TEST_F(EvaluateVerb, BadArgumentsAreErrorsOfOneLine) {
  test::write_bytes(temp_ / "foreign/file.txt", "text");
  const std::vector<std::vector<std::string>> wrong = {command("no placeholders"),
                                                       command("a {dataset}"),
                                                       command("a {dataset} {out}", {"--name", "../x"}),
                                                       {"evaluate", "nowhere", "--with", "a {dataset} {out}"},
                                                       {"evaluate", (temp_ / "suite.yaml").string(), "--with",
                                                        "a {dataset} {out}", "--out", (temp_ / "foreign").string()},
                                                       {"evaluate", (temp_ / "suite.yaml").string()}};
  for (const auto& arguments : wrong) {
    const test::Finished finished = test::run_program(arguments);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  }
  EXPECT_FALSE(test::fs::exists(temp_ / "out"));
}

}  // namespace
}  // namespace fringeslam
