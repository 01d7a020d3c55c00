// SPDX-License-Identifier: Apache-2.0
// Errors of poses relative to their own covariances.
#pragma once

#include "core/types/pose.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Error of a camera's pose (docs/method.md, section 13).
struct PoseHonesty {
  double off_m = 0;  // largest displacement of points on the camera's axis and corner rays at the middle of its range
  double squared_sigmas = 0;  // e^T C^-1 e with the error e in the tangent space of retract(); NaN if C has no inverse

  double sigmas() const;
  // Returns whether the pose is off by more than 1 mm and by more than 10 of its own sigmas; a covariance that is not positive
  // definite counts as too small.
  bool confidently_wrong() const;
};

// Compares a pose a_from_camera with its true value; the covariance is in the tangent space of retract().
PoseHonesty pose_honesty(const Pose& estimate, const Pose& truth, const Matrix6d& covariance, const RigModel& rig);

}  // namespace fringeslam
