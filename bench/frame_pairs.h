// SPDX-License-Identifier: Apache-2.0
// Two views of a generated scene with a given camera motion between them.
#pragma once

#include <string>

#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam::bench {

struct FramePair {
  RigModel rig;
  Frame target, source;
  Pose target_from_source;  // ground truth, between the cameras
};

// Renders the pair from the scene's first pose.
FramePair rendered_frames(const std::string& scene_name, uint64_t seed, const Pose& target_from_source);

// Returns a rotation of the camera by an angle about a random axis through a point within its working range, and a
// shift.
Pose random_motion(double degrees, double metres, double middle_m, uint64_t seed);

}  // namespace fringeslam::bench
