// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "sim/virtual_rig.h"

namespace fringeslam::tools {

// Renders a scene's first view under its finest fringes: without any effect, with each one alone, and with all of them.
cv::Mat3b effects_picture(const sim::Scene& scene, const sim::RenderOptions& options);

}  // namespace fringeslam::tools
