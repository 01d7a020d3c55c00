// SPDX-License-Identifier: Apache-2.0
// Landmarks as files (the columns and keys are in tools/README.md).
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "core/mapper/pipeline.h"

namespace fringeslam::tools {

// Matrix A: a line for each depth keypoint, under a head (thesis Table 1, and the columns that clustering adds).
std::string keypoint_table(const Landmarks& landmarks);

// A view's landmarks and which of them were recognised.
nlohmann::ordered_json landmarks_json(int index, const FrameResult& view);

// Warm things of the map, victims among them, in the map's world.
nlohmann::ordered_json to_json(const std::vector<WarmThing>& things);

}  // namespace fringeslam::tools
