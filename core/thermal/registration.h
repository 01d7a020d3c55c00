// SPDX-License-Identifier: Apache-2.0
// Registration of the thermal image to the frame (docs/method.md, section 10): each pixel's 3D point is projected into
// the thermal camera.
#pragma once

#include "core/thermal/options.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// H x W, aligned with the frame; NaN where the thermal camera does not see the pixel's point.
struct RegisteredThermal {
  cv::Mat1f temperature_c;  // apparent temperature, bilinear
  cv::Mat1f around_c;       // highest temperature within halo_px
};

// Registers the thermal image `thermal_c` to the points `points_m` (camera frame). Throws Error if the rig has no
// thermal camera or the image does not have its size.
RegisteredThermal register_thermal(const cv::Mat3f& points_m, const cv::Mat1f& thermal_c, const RigModel& rig,
                                   const ThermalOptions& options);

}  // namespace fringeslam
