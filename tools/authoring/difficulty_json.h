// SPDX-License-Identifier: Apache-2.0
// The difficulty of a view as JSON, for `scene check --difficulty` and the page of a scene.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/authoring/difficulty.h"

namespace fringeslam::tools {

// Members are those of ViewDifficulty; unknown and infinite values are null. `strain` and `reasons` are objects by the
// names of Hardship; `reasons` has those beyond their limit.
nlohmann::ordered_json difficulty_json(const ViewDifficulty& view);

}  // namespace fringeslam::tools
