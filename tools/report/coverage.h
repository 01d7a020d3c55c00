// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "core/calibrate/rig_calibration.h"

namespace fringeslam::tools {

// Where the boards' corners fell in the camera's and in the projector's image, side by side, each with its residual as a
// line, enlarged, from green (small) to red; corners of views left out are grey.
cv::Mat3b coverage_picture(const RigCalibration& calibration);

}  // namespace fringeslam::tools
