// SPDX-License-Identifier: Apache-2.0
// Results of systems on the datasets of suites, and their comparison as a table and a page.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "core/score/score.h"

namespace fringeslam::evaluation {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// One system on one dataset. NaN: not measured.
struct Result {
  std::string suite, dataset, dataset_hash, system, command;
  std::string end;      // to_string(ProcessEnd), or "no_trajectory"
  std::string message;  // why the result cannot be scored
  int views = 0, poses = 0;
  double ate_m = kNone;         // translation, best SE(3) alignment
  double ate_origin_m = kNone;  // translation, first poses aligned
  double rpe_m = kNone, rpe_rad = kNone;
  double precision = kNone, recall = kNone, f_score = kNone, threshold_m = kNone;  // of the map
  double seconds = kNone, peak_mib = kNone;
  double timeout_s = kNone, memory_mib = kNone;  // the limits

  bool has_trajectory() const { return ate_m == ate_m; }
  double tracked() const { return views > 0 ? static_cast<double>(poses) / views : 0; }
};

// Summary of a system on a suite: medians over datasets with 95 % bootstrap intervals.
struct Standing {
  std::string suite, system;
  int datasets = 0, scored = 0;  // scored: with a trajectory
  double tracked = 0;            // mean over all datasets; 0 for those without a trajectory
  MedianInterval ate_m, rpe_m, rpe_rad, f_score, seconds_per_view, peak_mib;
};

// Returns standings by suite, in it by the share of scored datasets, then that of tracked views, then by ATE.
std::vector<Standing> standings_of(const std::vector<Result>& results);

// Sets the result's numbers that a trajectory's score contains.
void set_score(Result& result, const TrajectoryScore& score);

// One line of JSON per result.
std::string to_lines(const std::vector<Result>& results);
// Reads such lines. Throws Error with file:line.
std::vector<Result> read_results(const std::filesystem::path& file);
// Replaces the result of the same system on the same dataset and suite, or appends.
void put(std::vector<Result>& results, const Result& result);

// The results in a folder: results.jsonl, leaderboard.csv and leaderboard.html. An absent or empty folder has none. Throws
// Error if the folder contains other files only.
std::vector<Result> results_in(const std::filesystem::path& folder);
// Writes these files, each completely or not at all.
void write_results(const std::filesystem::path& folder, const std::vector<Result>& results);
// Reads the results and writes the files anew, which creates the folder if there is none. Throws Error as results_in().
std::vector<Result> open_results(const std::filesystem::path& folder);
// Reads the results, puts this one, and writes them. Several processes may do so at a time.
void add_result(const std::filesystem::path& folder, const Result& result);

std::string to_csv(const std::vector<Result>& results);
// Returns a self-contained page.
std::string to_html(const std::vector<Result>& results);
// Returns the standings as text.
std::string to_table(const std::vector<Standing>& standings);

}  // namespace fringeslam::evaluation
