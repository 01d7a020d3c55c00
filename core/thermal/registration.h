// SPDX-License-Identifier: Apache-2.0
// The thermal camera's image laid onto the frame's: each pixel's 3D point is looked up where the thermal camera sees
// it.
#pragma once

#include "core/thermal/options.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// H x W, pixel for pixel the frame's; NaN where the thermal camera does not see the pixel's point.
struct RegisteredThermal {
  cv::Mat1f temperature_c;  // apparent, between pixels of the thermal camera linearly
  cv::Mat1f around_c;       // the greatest within halo_px
};

// `points_m`: camera frame. The rig must have a thermal camera, and `thermal_c` its size, else Error.
RegisteredThermal register_thermal(const cv::Mat3f& points_m, const cv::Mat1f& thermal_c, const RigModel& rig,
                                   const ThermalOptions& options);

}  // namespace fringeslam
