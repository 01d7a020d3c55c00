// SPDX-License-Identifier: Apache-2.0
// Timed robot poses and the TUM RGB-D text format: `timestamp tx ty tz qx qy qz qw`, one pose per line.
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

// Reads a TUM trajectory file. Throws Error with file:line if a line is not eight finite numbers, if a quaternion's
// norm differs from 1 by more than 1e-3, or if timestamps do not increase.
Trajectory read_tum(const std::filesystem::path& file);

}  // namespace fringeslam
