// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/leaderboard.h"

#include <gmock/gmock.h>

#include <cmath>

#include "tests/support/temp_folder.h"

namespace fringeslam::evaluation {
namespace {

using testing::HasSubstr;
using testing::Not;

Result result_of(const std::string& system, const std::string& dataset, double ate_m) {
  Result result;
  result.suite = "stills";
  result.dataset = dataset;
  result.system = system;
  result.command = system + " {dataset} {out}";
  result.end = "finished";
  result.views = 10;
  result.poses = 10;
  result.ate_m = result.ate_origin_m = ate_m;
  result.seconds = 5;
  return result;
}

Result failed(const std::string& system, const std::string& dataset) {
  Result result;
  result.suite = "stills";
  result.dataset = dataset;
  result.system = system;
  result.end = "timed_out";
  result.message = "took longer than 1 s";
  result.views = 10;
  return result;
}

TEST(Leaderboard, MediansAreThoseOfScoredDatasets) {
  const std::vector<Result> results = {result_of("a", "1", 1), result_of("a", "2", 3), result_of("a", "3", 10),
                                       failed("a", "4")};
  const auto standings = standings_of(results);
  ASSERT_EQ(standings.size(), 1);
  EXPECT_EQ(standings[0].datasets, 4);
  EXPECT_EQ(standings[0].scored, 3);
  EXPECT_EQ(standings[0].ate_m.median, 3);
  EXPECT_EQ(standings[0].ate_m.low, 1);
  EXPECT_EQ(standings[0].ate_m.high, 10);
  EXPECT_DOUBLE_EQ(standings[0].tracked, 0.75);
  EXPECT_DOUBLE_EQ(standings[0].seconds_per_view.median, 0.5);
  EXPECT_TRUE(std::isnan(standings[0].f_score.median));
}

TEST(Leaderboard, TheIntervalOfAMedianCoversItAsOftenAsStated) {
  // Values i = 0 … 8 of a uniform distribution: the median 4 lies in the interval, which excludes the extremes.
  std::vector<Result> results;
  for (int i = 0; i < 9; ++i) results.push_back(result_of("a", std::to_string(i), i));
  const MedianInterval ate = standings_of(results)[0].ate_m;
  EXPECT_EQ(ate.median, 4);
  EXPECT_GE(ate.low, 1);
  EXPECT_LE(ate.high, 7);
}

TEST(Leaderboard, AFailureRanksBehindASuccess) {
  const auto standings = standings_of({result_of("exact", "1", 1e-6), failed("exact", "2"), result_of("robust", "1", 1),
                                       result_of("robust", "2", 1), failed("broken", "1")});
  ASSERT_EQ(standings.size(), 3);
  EXPECT_EQ(standings[0].system, "robust");
  EXPECT_EQ(standings[1].system, "exact");
  EXPECT_EQ(standings[2].system, "broken");
}

TEST(Leaderboard, LosingViewsRanksBehindTrackingThem) {
  Result half = result_of("half", "1", 1e-6);
  half.poses = 5;
  const auto standings = standings_of({half, result_of("all", "1", 1e-3)});
  EXPECT_EQ(standings[0].system, "all");
}

TEST(Leaderboard, LinesReadBackUnchanged) {
  const test::TempFolder temp;
  std::vector<Result> results = {result_of("a", "1", 0.1 + 0.2), failed("b \"x\"\n", "2")};
  write_results(temp / "out", results);
  const std::vector<Result> back = results_in(temp / "out");
  ASSERT_EQ(back.size(), 2);
  EXPECT_EQ(to_lines(back), to_lines(results));
  EXPECT_EQ(back[0].ate_m, results[0].ate_m);
  EXPECT_TRUE(std::isnan(back[1].ate_m));
  EXPECT_TRUE(test::fs::exists(temp / "out/leaderboard.html"));
  EXPECT_TRUE(test::fs::exists(temp / "out/leaderboard.csv"));
}

TEST(Leaderboard, DamagedResultsAndForeignFoldersAreErrors) {
  const test::TempFolder temp;
  EXPECT_TRUE(results_in(temp / "absent").empty());
  test::write_bytes(temp / "a/results.jsonl", to_lines({result_of("a", "1", 1)}) + "{\"suite\":");
  test::write_bytes(temp / "b/thesis.tex", "text");
  test::write_bytes(temp / "c", "a file");
  for (const std::string folder : {"a", "b", "c"}) EXPECT_THROW(results_in(temp / folder), Error);
  EXPECT_THROW(write_results(temp / "c/below", {}), Error);
  try {
    results_in(temp / "a");
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("results.jsonl:2"));
  }
}

TEST(Leaderboard, PutReplacesTheSameSystemOnTheSameDataset) {
  std::vector<Result> results = {result_of("a", "1", 1), result_of("b", "1", 2)};
  put(results, result_of("a", "1", 3));
  put(results, result_of("a", "2", 4));
  ASSERT_EQ(results.size(), 3);
  EXPECT_EQ(results[0].ate_m, 3);
}

TEST(Leaderboard, CsvQuotesCommasAndQuotes) {
  Result result = result_of("a, \"b\"", "1", 1);
  result.message = "two\nlines";
  const std::string csv = to_csv({result});
  EXPECT_THAT(csv, HasSubstr("\"a, \"\"b\"\"\""));
  EXPECT_THAT(csv, HasSubstr("\"two\nlines\""));
}

TEST(Leaderboard, ThePageEscapesWhatSystemsSupply) {
  Result result = failed("<script>alert(1)</script>", "1");
  result.message = "a < b & \"c\"";
  const std::string html = to_html({result});
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_THAT(html, HasSubstr("&lt;script&gt;alert(1)"));
  EXPECT_THAT(html, HasSubstr("a &lt; b &amp; &quot;c&quot;"));
  EXPECT_THAT(html, Not(HasSubstr("http")));  // nothing is loaded from elsewhere
}

}  // namespace
}  // namespace fringeslam::evaluation
