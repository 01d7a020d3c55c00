// SPDX-License-Identifier: Apache-2.0
// The result of a rig calibration as an HTML page with pictures.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <vector>

#include "core/calibrate/rig_calibration.h"

namespace fringeslam::tools {

// Writes calibration.html and one picture per used view, views/NNNNNN.png: its texture with the corners and their
// residuals. `textures` holds the evenly lit image of each view. The page also shows coverage.png.
void write_calibration_page(const std::filesystem::path& folder, const RigCalibration& calibration,
                            const std::vector<cv::Mat1f>& textures);

}  // namespace fringeslam::tools
