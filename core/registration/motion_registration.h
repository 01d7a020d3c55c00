// SPDX-License-Identifier: Apache-2.0
// Joint estimation of a frame's pose and of the motion during its stack (docs/method.md, section 9.4).
//
// A wrong motion distorts the depth of a frame by dz_i = s_i . d(motion), with slopes s_i that differ from pixel to pixel
// (ripples of twice the fringes' frequency, and texture). Registered to a frame that is not distorted in the same way,
//
//   r_i = n_i . (T (P_i + d_i dz_i) - q_i)
//
// depends on the pose T and on the motion. Gauss-Newton over both, 18 unknowns, with a prior on the motion.
#pragma once

#include <vector>

#include "core/types/camera_motion.h"
#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

using Matrix6x12d = Eigen::Matrix<double, 6, 12>;

struct MotionRegistration {
  Pose target_from_source;
  Vector12d step = Vector12d::Zero();                // to be added to the motion that the source was decoded with
  Matrix12d motion_covariance = Matrix12d::Zero();   // with the pose unknown
  Matrix6x12d pose_by_motion = Matrix6x12d::Zero();  // see pose_by_motion()
  double ripple_sigma = 0;                           // RMS of the step's effect on the depths, in sigmas of the depth
  double prior_scale = 1;                            // by which the prior's covariance was multiplied, at least 1
  int pairs = 0;
  bool valid = false;
};

// Registers `source`, decoded with the motion `current`, to `target`, starting at `initial`. `slopes` are those of the
// source's pixels. If the motion that explains the depths contradicts the prior, the prior's covariance is multiplied by the
// most probable factor. Not valid if too few points correspond.
MotionRegistration register_motion(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                                   const std::vector<DepthSlope>& slopes, const CameraMotion& current,
                                   const MotionPrior& prior);

// Returns the derivative of the pose of `source` registered to `target`, in the tangent of retract(), with respect to the
// motion that `source` is decoded with: with the covariance C of the motion, the pose has the additional covariance
// D C D^T. Zero if too few points correspond.
Matrix6x12d pose_by_motion(const Frame& target, const Frame& source, const Pinhole& camera,
                           const Pose& target_from_source, const std::vector<DepthSlope>& slopes);

}  // namespace fringeslam
