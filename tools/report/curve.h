// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "core/calibrate/response.h"

namespace fringeslam::tools {

// The measured response (points), its table (line) and a linear one (grey): light over input, both from 0 to 1.
cv::Mat3b curve_picture(const Response& response);

}  // namespace fringeslam::tools
