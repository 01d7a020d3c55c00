// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "core/calibrate/rig_calibration.h"

namespace fringeslam::tools {

// Draws the board corners of all views in the camera's and the projector's image, side by side, each with its magnified
// residual as a line from green (small) to red; corners of rejected views are grey.
cv::Mat3b coverage_picture(const RigCalibration& calibration);

}  // namespace fringeslam::tools
