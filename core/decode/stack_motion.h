// SPDX-License-Identifier: Apache-2.0
// The camera's motion during a stack, estimated from the stack's own images (docs/method.md, section 9.3), and how the
// decoded coordinate depends on it.
//
// A stack with several fringe periods overdetermines its pixels: at a surface point, the periods must agree in the mean
// intensity I' and in the absolute phase. With G periods that leaves 2 (G - 1) residuals per pixel. The wrong motion
// violates them, because texture and fringes drift across the pixel between exposures.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "core/decode/decode.h"
#include "core/types/camera_motion.h"

namespace fringeslam {

enum class MotionSearch {
  wide,         // starts from blurred images and uses few pixels: a start for the last one
  accelerated,  // the same for a camera that may accelerate strongly, close to the prior's motion
  close         // starts at the prior's motion, accurate to about a pixel of displacement
};

// Estimates the motion during a stack with at least two periods along `axis`. `depth_m` is a rough depth image without
// unknown pixels (filled_depth()); it need not be compensated for motion. Grey values from `clip_dn` on are saturated, and are
// left out. Returns
// converged = false if the stack has one period only, if too few pixels have texture or fringes, or if no motion
// explains the images.
StackMotion estimate_stack_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                  const cv::Mat1f& depth_m, double clip_dn, const MotionPrior& prior,
                                  MotionSearch search, Axis axis = Axis::columns);

// Returns false if the images of a stack agree with a camera at rest. A quick test; true may also mean that the images contain
// other errors. Empty if the stack cannot show motion: it has one period only, or too few pixels with texture or fringes.
std::optional<bool> shows_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                 const cv::Mat1f& depth_m, double clip_dn, Axis axis = Axis::columns);

// Returns the slopes of every `stride`-th pixel with a known depth in every `stride`-th row, for the fringes of this period
// in a stack decoded with this motion. `depth_m` is the decoded depth; `steps`: as in the options of its decoding.
std::vector<DepthSlope> depth_slopes(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                     const cv::Mat1f& depth_m, double clip_dn, const CameraMotion& motion,
                                     double period_px, int stride, Axis axis = Axis::columns, int steps = 0);

}  // namespace fringeslam
