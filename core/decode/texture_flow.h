// SPDX-License-Identifier: Apache-2.0
// The camera's motion from the displacement of texture between the fringe periods of a stack (docs/method.md, section
// 9.3): a start for the estimation from all images, which converges only within a few pixels of displacement.
#pragma once

#include <optional>

#include "core/decode/decode.h"
#include "core/types/camera_motion.h"

namespace fringeslam {

// Estimates the motion during a stack from the texture in its images. `depth_m` is a rough depth image without unknown
// pixels (filled_depth()). Accelerations are those of the prior. Returns empty if the stack has one period only, or if too
// little texture could be tracked.
std::optional<CameraMotion> motion_from_texture(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                                const cv::Mat1f& depth_m, const MotionPrior& prior,
                                                Axis axis = Axis::columns);

}  // namespace fringeslam
