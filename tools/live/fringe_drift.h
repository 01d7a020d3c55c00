// SPDX-License-Identifier: Apache-2.0
// Does the robot move too fast for its fringes? While it moves, the projector coordinate u seen by a pixel drifts at
// u' (core/decode/motion_compensation.h), that is by u' / f per phase step at camera rate f. In periods p of the finest fringes,
//
//   d = |u'| / (f p)
//
// the uncompensated wrapped phase is off by up to 2 pi d / sqrt 3 (docs/method.md, section 9), and the fringe order,
// computed from three images at each of several periods, by 3 d of the half period that it tolerates.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/decode/motion_compensation.h"

namespace fringeslam::tools {

// Phase error of 0.18 rad, and a third of the error that the fringe order tolerates.
inline constexpr double kFastestDrift = 0.05;

// Returns the median of d over the frame's points in every eighth row and column; empty if the frame has no points or
// no fringes. `rays` are the rig camera's.
std::optional<double> fringe_drift(const Frame& frame, const PixelRays& rays, const RigModel& rig,
                                   const CameraTwist& twist, double finest_period_px);

// Returns the constant twist that makes this motion in `duration_s`; zero if the duration is not positive.
CameraTwist mean_twist(const Pose& previous_from_current, double duration_s);

// Returns advice for the operator; empty up to kFastestDrift.
std::vector<std::string> drift_warnings(std::optional<double> drift);

}  // namespace fringeslam::tools
