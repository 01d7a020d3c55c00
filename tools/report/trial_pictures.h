// SPDX-License-Identifier: Apache-2.0
// Pictures of the views of a study's trial.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "bench/studies/trial_run.h"

namespace fringeslam::tools {

// Runs the trial again and returns {trial, limit_mm, views: [{index, lost, width, height, texture, error}]} of at most
// four views, including the first and the last. texture and error are data URLs as in view_pictures.h; the levels of
// `error` span ±limit_mm, 0 is a pixel without depth. Returns {trial, unpictured} if the trial is rejected before its
// first view.
nlohmann::ordered_json trial_pictures(const studies::Study& study, const studies::Trial& trial);

}  // namespace fringeslam::tools
