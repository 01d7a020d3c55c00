// SPDX-License-Identifier: Apache-2.0
// Motion of the camera while a stack is exposed (docs/method.md, section 9.1).
#pragma once

#include <Eigen/Core>

#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

// Third-order expansion about the stack's reference time: at time t after it, the camera has turned by
// exp(angular_rad_s t + angular_rad_s2 t^2 / 2 + angular_rad_s3 t^3 / 6) and moved by
// velocity_m_s t + acceleration_m_s2 t^2 / 2 + jerk_m_s3 t^3 / 6, both in the axes of the camera at the reference time.
struct CameraMotion {
  Eigen::Vector3d angular_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_rad_s2 = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration_m_s2 = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_rad_s3 = Eigen::Vector3d::Zero();
  Eigen::Vector3d jerk_m_s3 = Eigen::Vector3d::Zero();

  bool is_still() const {
    return angular_rad_s.isZero(0) && velocity_m_s.isZero(0) && angular_rad_s2.isZero(0) &&
           acceleration_m_s2.isZero(0) && angular_rad_s3.isZero(0) && jerk_m_s3.isZero(0);
  }
  // reference_from_camera at time t after the reference time.
  Pose at(double time_s) const {
    const double square = time_s * time_s / 2, cube = time_s * time_s * time_s / 6;
    return {rotation_exp(time_s * angular_rad_s + square * angular_rad_s2 + cube * angular_rad_s3),
            time_s * velocity_m_s + square * acceleration_m_s2 + cube * jerk_m_s3};
  }
};

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

// Motion parameters in the order (angular_rad_s, velocity_m_s, angular_rad_s2, acceleration_m_s2). The third order is
// estimated from a stack only, and its uncertainty is contained in that of these twelve.
Vector12d to_vector(const CameraMotion& motion);
CameraMotion to_motion(const Vector12d& parameters);

// Adds `change` to the parameters above and keeps the third order.
CameraMotion changed(const CameraMotion& motion, const Vector12d& change);

// Estimate of the motion during a stack.
struct StackMotion {
  CameraMotion motion;                       // still: no motion could be detected
  Matrix12d covariance = Matrix12d::Zero();  // of to_vector(motion)
  double rms_sigma = 0;                      // of the residuals; 1 if the sigmas are correct
  int residuals = 0;
  bool converged = false;  // false: the motion is unknown
};

// Motions that are expected of a robot without further knowledge.
struct MotionLimits {
  double max_speed_m_s = 1, max_turn_rad_s = 1.6;   // standard deviations of an unknown motion
  double acceleration_m_s2 = 0.5, turn_rad_s2 = 1;  // within a stack, standard deviations

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_speed_m_s", max_speed_m_s, {1e-3, 100},
            "standard deviation of each component of an unknown velocity, m/s");
    v.field("max_turn_rad_s", max_turn_rad_s, {1e-3, 100},
            "standard deviation of each component of an unknown turn rate, rad/s");
    v.field("acceleration_m_s2", acceleration_m_s2, {1e-3, 1000},
            "standard deviation of each component of the acceleration during a stack and between stacks, m/s^2");
    v.field("turn_rad_s2", turn_rad_s2, {1e-3, 1000},
            "standard deviation of each component of the angular acceleration, rad/s^2");
  }
};

// Knowledge about a motion before its stack is looked at.
struct MotionPrior {
  CameraMotion motion;
  Matrix12d covariance;
};
MotionPrior unknown_motion(const MotionLimits& limits);

// Returns the mean square of the motion, given its estimate: the covariance of its difference from rest.
Matrix12d mean_square(const StackMotion& motion);

// True if the estimate is significantly different from rest.
bool is_moving(const StackMotion& motion);

// False if turn rate and velocity differ significantly from those of the prior.
bool agrees(const StackMotion& found, const MotionPrior& prior);

// Probability that the camera moved, if rest was as likely before as a speed of unknown order of magnitude.
double probability_of_motion(const StackMotion& motion);

// Derivative of a pixel's depth with respect to to_vector(motion), m.
struct DepthSlope {
  int row = 0, col = 0;
  Vector12d by_motion;
};

}  // namespace fringeslam
