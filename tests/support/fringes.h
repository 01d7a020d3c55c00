// SPDX-License-Identifier: Apache-2.0
// Fringe images straight from the equation I_k = I' + I'' cos(Phi + delta_k) [C eq. 1], and Gray bits and flat
// levels between the same extremes: no optics.
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"
#include "tests/support/random.h"

namespace fringeslam::support {

struct FringeLight {
  double mean_dn = 120, modulation_dn = 90;  // I', I''
};

// Images of cv type CV_8UC1, CV_16UC1 (both rounded) or CV_32FC1 of a surface whose pixels see the given
// projector coordinates. With `noise`, the sensor's temporal noise is added before rounding.
FringeStack fringe_stack(const cv::Mat1d& coordinate_px, const PatternSequence& sequence, const FringeLight& light,
                         int type, const SensorModel& sensor = {}, Random* noise = nullptr);

// One row of `count` coordinates from first to last.
cv::Mat1d ramp(double first, double last, int count);

}  // namespace fringeslam::support
