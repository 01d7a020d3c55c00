// SPDX-License-Identifier: Apache-2.0
// Prediction of the camera's pose and motion from the poses of the last views (docs/method.md, section 9.4).
#pragma once

#include <optional>
#include <vector>

#include "core/types/camera_motion.h"
#include "core/types/trajectory.h"

namespace fringeslam {

// Variance of each component of a pose: isotropic within rotation and within translation.
struct PoseVariance {
  double turn_rad2 = 0, shift_m2 = 0;

  PoseVariance operator+(const PoseVariance& other) const {
    return {turn_rad2 + other.turn_rad2, shift_m2 + other.shift_m2};
  }
};

// Returns the means of the variances of a covariance in the tangent of retract().
PoseVariance pose_variance(const Matrix6d& covariance);

// A tracked view.
struct PoseSample {
  double timestamp_s = 0;
  Pose world_from_camera;
  PoseVariance variance;  // without errors that all samples share
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

// The same at a time before all samples: reversed in time, the later samples predict the earlier ones.
std::optional<MotionPrediction> predict_backwards(std::vector<PoseSample> samples, double timestamp_s,
                                                  const MotionLimits& limits);

// Combines two independent estimates of a motion.
MotionPrior fused(const MotionPrior& one, const MotionPrior& other);

// Displacements of single images from a smooth path, standard deviation of each component.
struct Jitter {
  double turn_rad = 0, shift_m = 0;
};

// Vibration that is too fast for the poses of the last views to follow, estimated from their scatter.
struct VibrationEstimate {
  Jitter expected;  // root mean square of the posterior
  Jitter least;     // exceeded with a probability of 95 %
};

// Estimates the vibration from samples in the order of time, later ones of which have more weight: the filters of
// predict_motion() with independent displacements of each view, averaged over their sizes as well. Each pose is the mean
// of the three images with the finest fringes. Few samples do not exclude vibration, so that `expected` is large for them.
// `camera_rate_hz` is the rate of single images.
VibrationEstimate estimate_vibration(const std::vector<PoseSample>& samples, const MotionLimits& limits,
                                     double camera_rate_hz);

// Largest velocity that displacements of one unit, independent from image to image, cause; the largest acceleration is
// twice this times the rate of the images (docs/method.md, section 9.4).
double velocity_of_jitter(double camera_rate_hz);

}  // namespace fringeslam
