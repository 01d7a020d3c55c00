// SPDX-License-Identifier: Apache-2.0
// Timed robot poses and their text format (TUM RGB-D): `timestamp tx ty tz qx qy qz qw`, one a line.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

struct TimedPose {
  double timestamp_s = 0;
  Pose world_from_robot;
};

using Trajectory = std::vector<TimedPose>;

std::string to_tum(const Trajectory& trajectory);

// Throws Error with file:line on a line that is not eight finite numbers, a quaternion that is not
// of unit length within 1e-3, or timestamps that do not increase.
Trajectory read_tum(const std::filesystem::path& file);

}  // namespace fringeslam
