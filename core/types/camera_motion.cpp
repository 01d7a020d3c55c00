// SPDX-License-Identifier: Apache-2.0
#include "core/types/camera_motion.h"

#include <cmath>

#include "core/types/linear_algebra.h"

namespace fringeslam {

Vector12d to_vector(const CameraMotion& motion) {
  Vector12d parameters;
  parameters << motion.angular_rad_s, motion.velocity_m_s, motion.angular_rad_s2, motion.acceleration_m_s2;
  return parameters;
}

CameraMotion to_motion(const Vector12d& parameters) { return changed({}, parameters); }

CameraMotion changed(const CameraMotion& motion, const Vector12d& change) {
  CameraMotion result = motion;
  result.angular_rad_s += change.segment<3>(0);
  result.velocity_m_s += change.segment<3>(3);
  result.angular_rad_s2 += change.segment<3>(6);
  result.acceleration_m_s2 += change.segment<3>(9);
  return result;
}

MotionPrior unknown_motion(const MotionLimits& limits) {
  Vector12d sigmas;
  sigmas << Eigen::Vector3d::Constant(limits.max_turn_rad_s), Eigen::Vector3d::Constant(limits.max_speed_m_s),
      Eigen::Vector3d::Constant(limits.turn_rad_s2), Eigen::Vector3d::Constant(limits.acceleration_m_s2);
  return {{}, sigmas.cwiseAbs2().asDiagonal()};
}

Matrix12d mean_square(const StackMotion& motion) {
  const Vector12d parameters = to_vector(motion.motion);
  return motion.covariance + parameters * parameters.transpose();
}

namespace {

// Squared Mahalanobis distance from rest: chi-square of twelve degrees of freedom for a camera at rest.
double square_from_rest(const StackMotion& motion) {
  const Vector12d parameters = to_vector(motion.motion);
  const Eigen::VectorXd whitened =
      solve_positive_definite(Eigen::MatrixXd(motion.covariance), Eigen::VectorXd(parameters));
  return parameters.dot(whitened);
}

}  // namespace

bool is_moving(const StackMotion& motion) {
  // One false alarm in 10^7 without systematic errors.
  constexpr double kMaxSquare = 55;
  return square_from_rest(motion) > kMaxSquare;
}

bool agrees(const StackMotion& found, const MotionPrior& prior) {
  constexpr double kUnlikely = 22.5;  // chi-square of six degrees of freedom, 0.1 %
  const Vector6d change = (to_vector(found.motion) - to_vector(prior.motion)).head<6>();
  const Matrix6d covariance = found.covariance.topLeftCorner<6, 6>() + prior.covariance.topLeftCorner<6, 6>();
  return change.dot(solve_symmetric(covariance, change)) < kUnlikely;
}

double probability_of_motion(const StackMotion& motion) {
  // At this square, the likelihood of the estimate makes up for the larger range of motions that it was chosen from.
  constexpr double kEven = 30;
  return 1 / (1 + std::exp(0.5 * (kEven - square_from_rest(motion))));
}

}  // namespace fringeslam
