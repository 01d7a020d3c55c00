// SPDX-License-Identifier: Apache-2.0
// Trajectories that other systems wrote, told apart by what is in them. `#` begins a comment in both:
//
//   TUM    timestamp_s x y z qx qy qz qw, between blanks
//   EuRoC  timestamp_ns,x,y,z,qw,qx,qy,qz, between commas; more columns are ignored
//
// Timestamps of a TUM file that begin beyond 1e14 are in nanoseconds, as ORB-SLAM3 writes them for EuRoC's sequences.
#pragma once

#include "core/types/trajectory.h"

namespace fringeslam {

// Throws Error as read_tum() does.
Trajectory read_trajectory(const std::filesystem::path& file);

}  // namespace fringeslam
