// SPDX-License-Identifier: Apache-2.0
// Summary of a study's results.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "bench/studies/statistics.h"
#include "bench/studies/study.h"

namespace fringeslam::studies {

// A class of trials with similar values of one parameter.
struct Class {
  std::string label;         // for a choice or a grid
  double low = 0, high = 0;  // for numbers
  int trials = 0, successes = 0;
  Interval rate_95;
  double median_mm = 0, p90_mm = 0;  // translation error of the trials that have one
};

struct ParameterSummary {
  std::string name;
  std::vector<Class> classes;
  SobolIndex of_success, of_error;  // shares of the variance of success (0 or 1), and of log10 of the translation error
  double safe_low = 0, safe_high = 0;  // bounds of the envelope below
};

struct WorstTrial {
  int trial = 0;
  std::string outcome, cause, command;
  double translation_mm = 0;
};

struct Summary {
  std::string name;
  int trials = 0, missing = 0, successes = 0;
  Interval rate_95;
  std::map<std::string, int> outcomes, causes;
  std::vector<std::pair<double, double>> error_percentiles_mm;  // percentile, translation error
  std::vector<ParameterSummary> parameters;
  // A box of parameters in which at least 99 % of the trials succeed, found by repeatedly peeling off the 5 % with the
  // most failures (Friedman and Fisher 1999). One half of the trials determines it, the other half its success rate.
  bool envelope = false;
  int envelope_trials = 0, envelope_successes = 0;
  Interval envelope_95;
  std::vector<WorstTrial> worst, worst_of_causes;  // the second: one per cause
};

// Summarizes merged result lines by trial; `worst`: number of worst trials to list.
Summary summarise(const Study& study, const std::map<int, std::string>& lines, int worst = 10);

nlohmann::ordered_json to_json(const Summary& summary);
std::string to_text(const Summary& summary);

}  // namespace fringeslam::studies
