// SPDX-License-Identifier: Apache-2.0
// Fringe images generated directly from the equation I_k = I' + I'' cos(Phi + delta_k) [C eq. 1], with Gray bits and
// flat levels between the same extremes; no optics are simulated.
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"
#include "tests/support/random.h"

namespace fringeslam::support {

struct FringeLight {
  double mean_dn = 120, modulation_dn = 90;  // I', I''
};

// Generates images of type CV_8UC1 or CV_16UC1 (both rounded) or CV_32FC1 whose pixels see the given projector
// coordinates. With `noise`, the sensor's temporal noise is added before rounding.
FringeStack fringe_stack(const cv::Mat1d& coordinate_px, const PatternSequence& sequence, const FringeLight& light,
                         int type, const SensorModel& sensor = {}, Random* noise = nullptr);

// Returns a stack of given images, one per pattern, at a regular clock with timestamp 0.
FringeStack stack_of(const PatternSequence& sequence, const std::vector<cv::Mat>& images);

// Returns one row of `count` equally spaced coordinates from first to last.
cv::Mat1d ramp(double first, double last, int count);

}  // namespace fringeslam::support
