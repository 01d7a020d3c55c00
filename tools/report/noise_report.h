// SPDX-License-Identifier: Apache-2.0
// Measured camera noise as text, JSON and a plot.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/calibrate/camera_noise.h"

namespace fringeslam::tools {

nlohmann::ordered_json to_json(const CameraNoise& noise);

// A table with 95 % confidence intervals.
std::string to_table(const CameraNoise& noise);

// One sentence for each reason to doubt the estimate.
std::vector<std::string> warnings_of(const CameraNoise& noise);

// Variance over grey value: measured (marks), fitted (line), of the rig's previous parameters (grey line).
cv::Mat3b picture_of(const CameraNoise& noise, const SensorModel& before);

}  // namespace fringeslam::tools
