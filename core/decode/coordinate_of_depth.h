// SPDX-License-Identifier: Apache-2.0
// Projector coordinate of a camera pixel with known depth, u = project(z R d + t), and its derivative du/dz at the
// fixed pixel, with the full lens model.
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// H x W; NaN where there is no depth or the point is behind the projector.
struct DepthCoordinate {
  cv::Mat1f coordinate_px, per_m;
};
DepthCoordinate coordinate_of_depth(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m, Axis axis);

}  // namespace fringeslam
