// SPDX-License-Identifier: Apache-2.0
// All that the page about a study shows.
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/studies/rows.h"
#include "bench/studies/summary.h"

namespace fringeslam::tools {

struct StudyLimits {
  size_t trials = 4000;       // in the scatter; of more every so manieth, and all that are named elsewhere
  size_t curve_points = 400;  // of a distribution
};

// The trials that the page pictures: the worst of each cause, then the other worst.
std::vector<studies::WorstTrial> pictured_trials(const studies::Summary& summary, int count);

// The keys are read by page/src/study. What is unknown is null.
//
//   version, name, description, seed, hash, scene: its file's name, design, planned: trials of the study
//   rule        max_translation_mm, max_rotation_deg, min_valid
//   replay      the command that does a trial again, but for its number at the end
//   summary     as summary.json
//   parameters  name, law, logarithmic, whole; low and high: what the study draws from, of normal what it drew;
//               values: of choice and grid
//   curves      translation_mm, rotation_deg: {count, none: trials without a motion to measure, percentiles: [percent,
//               error] of 50, 90 and 99 %, points: [error, share of the count that is not above it]}
//   trials      every: each so manieth is here; outcomes, causes: names; and columns of equal length: trial, outcome,
//               cause: places in those names, or -1, translation_mm, rotation_deg, values: a column for each
//               parameter, of a choice or grid the places in its values
//   worst       as summary.json's, and message: of an error, values: texts by parameter, views and limit_mm:
//               trial_pictures.h, or unpictured: why there are none
//
// `pictures`: by trial, an object with views or unpictured.
nlohmann::ordered_json study_data(const studies::Study& study, const std::vector<studies::Row>& rows,
                                  const studies::Summary& summary, const std::vector<studies::WorstTrial>& worst,
                                  const std::map<int, nlohmann::ordered_json>& pictures,
                                  const StudyLimits& limits = {});

}  // namespace fringeslam::tools
