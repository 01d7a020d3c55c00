// SPDX-License-Identifier: Apache-2.0
// Reads what the simulator wrote beside the frames, and the depth files of a run.
#pragma once

#include <filesystem>

#include "core/score/score.h"

namespace fringeslam {

// truth/NNNNNN.exr; the pose and time of the result are left empty. Throws Error on a missing file or channel.
TruthFrame read_truth_frame(const std::filesystem::path& file);

// frames/NNNNNN/depth.exr of a run: channels depth_m, sigma_m, projector_column.
DepthEstimate read_depth_estimate(const std::filesystem::path& file);

}  // namespace fringeslam
