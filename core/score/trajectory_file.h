// SPDX-License-Identifier: Apache-2.0
// Reads trajectories written by other systems; the format is detected from the content. `#` starts a comment in both:
//
//   TUM    timestamp_s x y z qx qy qz qw, separated by blanks
//   EuRoC  timestamp_ns,x,y,z,qw,qx,qy,qz, separated by commas; further columns are ignored
//
// If the first timestamp of a TUM file exceeds 1e14, timestamps are in nanoseconds, as ORB-SLAM3 writes them for EuRoC.
#pragma once

#include <filesystem>

#include "core/types/trajectory.h"

namespace fringeslam {

// Reads a TUM or EuRoC trajectory. Throws Error under the same conditions as tum_from_text().
Trajectory read_trajectory(const std::filesystem::path& file);

}  // namespace fringeslam
