// SPDX-License-Identifier: Apache-2.0
// Timed robot poses and the TUM RGB-D text format: `timestamp tx ty tz qx qy qz qw`, one pose per line.
#pragma once

#include <string>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

struct TimedPose {
  double timestamp_s = 0;
  Pose world_from_robot;
};

using Trajectory = std::vector<TimedPose>;

// Largest coordinate that is read from a file. Squares of positions have to remain finite.
constexpr double kMostPosition_m = 1e9;

std::string to_tum(const Trajectory& trajectory);

// Parses the text of a TUM trajectory file called `name`. Throws Error with name:line if a line is not eight finite
// numbers, if a quaternion's norm differs from 1 by more than 1e-3, if timestamps do not increase, if a
// coordinate exceeds kMostPosition_m, or if there is no pose.
Trajectory tum_from_text(const std::string& text, const std::string& name);

}  // namespace fringeslam
