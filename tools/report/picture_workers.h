// SPDX-License-Identifier: Apache-2.0
// Pictures of trials, rendered in separate processes, so that a trial that crashes again does no other harm.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "bench/studies/summary.h"
#include "bench/studies/workers.h"

namespace fringeslam::tools {

// Returns for each trial the result of trial_pictures(), or `unpictured` with the reason why there are no pictures.
// Trials that timed out in the study are not run again. `workers`: the command's workers answer with trial_pictures().
// Throws Error if interrupted by `stop`.
std::map<int, nlohmann::ordered_json> pictures_of(const studies::Study& study,
                                                  const std::vector<studies::WorstTrial>& trials,
                                                  const studies::WorkerOptions& workers,
                                                  const std::function<bool()>& stop);

}  // namespace fringeslam::tools
