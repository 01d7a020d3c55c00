// SPDX-License-Identifier: Apache-2.0
// What the views of a study's trial looked like.
#pragma once

#include <nlohmann/json.hpp>

#include "bench/studies/trial_run.h"

namespace fringeslam::tools {

// Runs the trial again: {trial, limit_mm, views: [{index, lost, width, height, texture, error}]}, of at most four
// views, the first and the last among them. texture and error: data URLs as of view_pictures.h, where the levels of
// `error` span ±limit_mm and 0 is a pixel without a depth. {trial, unpictured} when it is refused before its first
// view.
nlohmann::ordered_json trial_pictures(const studies::Study& study, const studies::Trial& trial);

}  // namespace fringeslam::tools
