// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "core/calibrate/response.h"

namespace fringeslam::tools {

// Plots a measured response: light over input, both from 0 to 1, with its samples, its table (line) and a linear
// response (grey).
cv::Mat3b curve_picture(const Response& response);

}  // namespace fringeslam::tools
