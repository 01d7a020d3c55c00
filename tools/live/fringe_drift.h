// SPDX-License-Identifier: Apache-2.0
// Does the robot move too fast for its fringes? While it moves, the projector coordinate u that a pixel sees drifts by
// u' (core/decode/motion.h), over one step of the phase by u' / f with f the camera's rate. In periods p of the finest
// fringes,
//
//   d = |u'| / (f p)
//
// the wrapped phase is off by up to 2 pi d / sqrt 3 (METHOD, motion during the sequence) before it is compensated, and
// the fringe order, told by three images each of several periods, by 3 d of the half period that it may be off.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/decode/motion.h"

namespace fringeslam::tools {

// Phase off by 0.18 rad, and a third of what an order may be off.
inline constexpr double kFastestDrift = 0.05;

// d, as half of the frame's points exceed it; every eighth row and column is looked at. Empty where the frame has no
// point, or no fringes. `rays` are those of the rig's camera.
std::optional<double> fringe_drift(const Frame& frame, const PixelRays& rays, const RigModel& rig,
                                   const CameraTwist& twist, double finest_period_px);

// Constant over `duration_s`, in which the camera moved so. Zero for a duration that is not positive.
CameraTwist mean_twist(const Pose& previous_from_current, double duration_s);

// What a person should do about it; nothing below kFastestDrift.
std::vector<std::string> drift_warnings(std::optional<double> drift);

}  // namespace fringeslam::tools
