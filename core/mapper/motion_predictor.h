// SPDX-License-Identifier: Apache-2.0
// Prediction of the camera's pose and motion from the poses of the last views (docs/method.md, section 9.4).
#pragma once

#include <optional>
#include <vector>

#include "core/types/camera_motion.h"
#include "core/types/trajectory.h"

namespace fringeslam {

// A tracked view. The covariances are isotropic within rotation and within translation.
struct PoseSample {
  double timestamp_s = 0;
  Pose world_from_camera;
  double turn_rad2 = 0, shift_m2 = 0;  // variance of each component of the pose
  // Motion during the view's stack if the stack determined it without a prediction.
  std::optional<StackMotion> motion = {};
};

struct MotionPrediction {
  Pose world_from_camera;
  double turn_rad = 0, shift_m = 0;  // standard deviation of each component of the pose
  MotionPrior motion;                // in the axes of the predicted camera
};

// Predicts pose and motion at `timestamp_s` from samples in the order of time, the last ones of which are used: Kalman
// filters with constant acceleration and white-noise jerk, averaged over intensities of the jerk by how well each
// predicted the samples (Bayesian model averaging), so that the covariance is small for smooth and large for jerky
// motion. Empty if there are no samples, or if there is one without a motion of its own, or if the last one is too old.
std::optional<MotionPrediction> predict_motion(const std::vector<PoseSample>& samples, double timestamp_s,
                                               const MotionLimits& limits);

}  // namespace fringeslam
