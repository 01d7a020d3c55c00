// SPDX-License-Identifier: Apache-2.0
// Reads trajectories in the TUM RGB-D text format (core/types/trajectory.h).
#pragma once

#include <filesystem>

#include "core/types/trajectory.h"

namespace fringeslam {

// Reads a TUM trajectory file. Throws Error under the same conditions as tum_from_text(), or if it cannot be read.
Trajectory read_tum(const std::filesystem::path& file);

}  // namespace fringeslam
