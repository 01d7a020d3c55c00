// SPDX-License-Identifier: Apache-2.0
// The data shown by a study's page.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "bench/studies/rows.h"
#include "bench/studies/summary.h"

namespace fringeslam::tools {

struct StudyLimits {
  size_t trials = 4000;       // in the scatter plot; of more, every n-th and those referred to elsewhere
  size_t curve_points = 400;  // per distribution
};

// Returns the trials to show pictures of: the worst of each cause, then the next worst.
std::vector<studies::WorstTrial> pictured_trials(const studies::Summary& summary, int count);

// Collects the data. The keys are read by page/src/study. Unknown values are null.
//
//   version, name, description, seed, hash, scene: file name, design, planned: trials of the study
//   rule        max_translation_mm, max_rotation_deg, min_valid
//   replay      the command that repeats a trial, without the trial number at its end
//   summary     as in summary.json
//   parameters  name, law, logarithmic, whole; low and high: the range of the study, for normal the range drawn;
//               values: of choice and grid
//   curves      translation_mm, rotation_deg: {count, none: trials without a motion to measure, percentiles: [percent,
//               error] at 50, 90 and 99 %, points: [error, fraction of the count that does not exceed it]}
//   trials      every: every n-th trial is included; outcomes, causes: names; and columns of equal length: trial,
//               outcome, cause: indices into those names, or -1, translation_mm, rotation_deg, values: a column for
//               each parameter, for a choice or grid indices into its values
//   worst       as in summary.json, and message: of an error, values: texts by parameter, views and limit_mm:
//               trial_pictures.h, or unpictured: why there are none
//
// `pictures`: by trial, an object with views or unpictured.
nlohmann::ordered_json study_data(const studies::Study& study, const std::vector<studies::Row>& rows,
                                  const studies::Summary& summary, const std::vector<studies::WorstTrial>& worst,
                                  const std::map<int, nlohmann::ordered_json>& pictures,
                                  const StudyLimits& limits = {});

}  // namespace fringeslam::tools
