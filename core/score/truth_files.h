// SPDX-License-Identifier: Apache-2.0
// Reads the ground-truth images that the simulator writes, and the depth files of a run.
#pragma once

#include <filesystem>

#include "core/score/score.h"

namespace fringeslam {

// Reads truth/NNNNNN.exr; leaves the result's pose, times and fringe orders empty, as well as position, projector row,
// temperature and indirect share if the file lacks them. Throws Error on a missing file or another missing channel, or
// if the image does not have the size of the camera, if one is given.
TruthFrame read_truth_frame(const std::filesystem::path& file, const Pinhole* camera = nullptr);

// Reads frames/NNNNNN/depth.exr of a run: channels depth_m, sigma_m, projector_column. Throws Error likewise.
DepthEstimate read_depth_estimate(const std::filesystem::path& file, const Pinhole* camera = nullptr);

}  // namespace fringeslam
