// SPDX-License-Identifier: Apache-2.0
// Alignment of a stack that was exposed in motion (docs/method.md, section 9.2).
//
// The point P = z d that a pixel sees at the reference time is seen by exposure k, in the camera's frame at that time, at
// P_k = M_k P: in the image at x_k = project_camera(P_k), lit by the projector coordinate
// u_k = project_projector(projector_from_camera P_k). Along the point,
//
//   I_k(x_k) = I' + I'' cos(2 pi (u + drift_k) / p + delta_k),   drift_k = u_k - u,
//
// so that images resampled at x_k decode like those of a camera at rest whose phase shifts differ from pixel to pixel.
// Grey values are scaled by the change of the point's brightness with distance and incidence, 1 to 2 % over a stack.
//
// x_k and drift_k change little with z: an error of 1 cm in z at 1 m moves x_k by 0.01 px during 3 mm of motion.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/camera_motion.h"
#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// One image of each per exposure, H x W.
struct AlignedStack {
  std::vector<cv::Mat1f> images;  // grey values at x_k, DN
  // drift_k; NaN where x_k is outside the image or, of fringes, beside a saturated pixel, or where no depth is known.
  std::vector<cv::Mat1f> drift_px;
};

// Aligns the images of a stack with its reference time, for a camera that moves as given and surfaces at `depth_m` (NaN:
// unknown). Grey values are interpolated by cubic B-splines; those from `clip_dn` on are saturated, which interpolation would
// hide. Throws Error if sizes differ.
AlignedStack align_stack(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                         const CameraMotion& motion, double clip_dn, Axis axis = Axis::columns);

// Returns the median drift until an exposure, in projector pixels along `axis`, at points of the camera's frame at the reference
// time; empty if the projector faces none of them.
std::optional<double> median_drift_px(const RigModel& rig, const std::vector<Eigen::Vector3d>& points_m,
                                      const Pose& exposure_from_reference, Axis axis);

// Returns the index of the group whose phase determines the coordinate best, by the median over the pixels: usually the
// finest, but the phase of fringes that drift by as much as they are shifted is hardly determined. `groups`: coarsest first.
size_t most_accurate_group(const AlignedStack& aligned, const std::vector<FringeGroup>& groups);

// Returns the depth image with unknown pixels filled by the average of their surroundings, from small to large; all NaN
// becomes `otherwise_m`.
cv::Mat1f filled_depth(const cv::Mat1f& depth_m, double otherwise_m);

}  // namespace fringeslam
