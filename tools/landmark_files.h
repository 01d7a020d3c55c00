// SPDX-License-Identifier: Apache-2.0
// Writes landmarks as CSV and JSON (tools/README.md lists the columns and keys).
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"

namespace fringeslam::tools {

// Returns matrix A as CSV with a header line: one line per depth keypoint (thesis Table 1, and the columns added by
// clustering).
std::string keypoint_table(const Landmarks& landmarks);

// Returns a view's landmarks and their re-identifications.
nlohmann::ordered_json landmarks_json(int index, const FrameResult& view, const ThermalView& thermal);

// Returns the warm objects of the map and which of them are victims, in the map's world frame.
nlohmann::ordered_json to_json(const std::vector<WarmObject>& things);

}  // namespace fringeslam::tools
