// SPDX-License-Identifier: Apache-2.0
// Pictures of trials, made in processes of their own: a trial that crashes again takes nothing with it.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "bench/studies/summary.h"
#include "bench/studies/workers.h"

namespace fringeslam::tools {

// By trial what trial_pictures() tells, or in `unpictured` why there is nothing to see. Trials that took too long in
// the study are not tried again. `workers`: their command's workers answer with trial_pictures(). Throws Error when
// `stop` says so.
std::map<int, nlohmann::ordered_json> pictures_of(const studies::Study& study,
                                                  const std::vector<studies::WorstTrial>& trials,
                                                  const studies::WorkerOptions& workers,
                                                  const std::function<bool()>& stop);

}  // namespace fringeslam::tools
