// SPDX-License-Identifier: Apache-2.0
#include "core/types/pose.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {
constexpr double kRadPerDeg = std::numbers::pi / 180.0;
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const Eigen::Matrix3d k = skew(omega);
  // Taylor series below 1e-4 rad: the closed form would divide rounding errors by the squared angle.
  const double a = angle < 1e-4 ? 1.0 - angle * angle / 6.0 : std::sin(angle) / angle;
  const double b = angle < 1e-4 ? 0.5 - angle * angle / 24.0 : (1.0 - std::cos(angle)) / (angle * angle);
  return Eigen::Matrix3d::Identity() + a * k + b * k * k;
}

Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation) {
  // Via the quaternion, which is well conditioned at 0 and at pi.
  const Eigen::Vector4d q = quaternion_xyzw(rotation);
  const Eigen::Vector3d axis = q.head<3>();
  const double sine = axis.norm();
  if (sine < 1e-12) return 2.0 * axis;
  return axis * (2.0 * std::atan2(sine, q.w()) / sine);
}

Pose retract(const Pose& pose, const Vector6d& tangent) {
  return {rotation_exp(tangent.head<3>()) * pose.rotation, pose.translation + tangent.tail<3>()};
}

Vector6d difference(const Pose& to, const Pose& from) {
  Vector6d tangent;
  tangent << rotation_log(to.rotation * from.rotation.transpose()), to.translation - from.translation;
  return tangent;
}

Matrix6d rotated_covariance(const Eigen::Matrix3d& rotation, const Matrix6d& covariance) {
  const Matrix6d turned = rotated_tangent(rotation);
  return turned * covariance * turned.transpose();
}

Matrix6d tangent_of_product(const Eigen::Vector3d& lever) {
  Matrix6d derivative = Matrix6d::Identity();
  derivative.bottomLeftCorner<3, 3>() = -skew(lever);
  return derivative;
}

Matrix6d rotated_tangent(const Eigen::Matrix3d& rotation) {
  Matrix6d rotated = Matrix6d::Zero();
  rotated.topLeftCorner<3, 3>() = rotated.bottomRightCorner<3, 3>() = rotation;
  return rotated;
}

Matrix6d tangent_of_inverse(const Pose& pose) {
  Matrix6d derivative = -rotated_tangent(pose.rotation.transpose());
  derivative.bottomLeftCorner<3, 3>() = -pose.rotation.transpose() * skew(pose.translation);
  return derivative;
}

Matrix6d covariance_of_inverse(const Pose& pose, const Matrix6d& covariance) {
  const Matrix6d derivative = tangent_of_inverse(pose);
  return derivative * covariance * derivative.transpose();
}

Pose orthonormalised(const Pose& pose) { return {nearest_rotation(pose.rotation), pose.translation}; }

Eigen::Vector4d quaternion_xyzw(const Eigen::Matrix3d& rotation) {
  Eigen::Vector4d xyzw = Eigen::Quaterniond(rotation).normalized().coeffs();
  return xyzw.w() < 0 ? Eigen::Vector4d(-xyzw) : xyzw;
}

Eigen::Matrix3d rotation_from_quaternion(const Eigen::Vector4d& xyzw) {
  return Eigen::Quaterniond(xyzw).normalized().toRotationMatrix();
}

SixDof six_dof(const Pose& pose) {
  const Eigen::Matrix3d& r = pose.rotation;
  SixDof six;
  six.translation_mm = pose.translation * 1e3;
  const double alpha = std::atan2(r(2, 1), r(2, 2));
  const double beta = std::atan2(-r(2, 0), std::hypot(r(2, 1), r(2, 2)));
  const double gamma = std::atan2(r(1, 0), r(0, 0));
  six.angles_deg = Eigen::Vector3d(alpha, beta, gamma) / kRadPerDeg;
  return six;
}

Pose pose_from(const SixDof& six) {
  const Eigen::Vector3d rad = six.angles_deg * kRadPerDeg;
  const Eigen::Matrix3d rotation =
      rotation_exp({0, 0, rad.z()}) * rotation_exp({0, rad.y(), 0}) * rotation_exp({rad.x(), 0, 0});
  return {rotation, six.translation_mm * 1e-3};
}

Pose align_points(const std::vector<Eigen::Vector3d>& to, const std::vector<Eigen::Vector3d>& from,
                  const std::vector<double>& variances) {
  const auto variance = [&](size_t i) { return variances.empty() ? 1 : variances[i]; };
  double weights = 0;
  Eigen::Vector3d to_mean = Eigen::Vector3d::Zero(), from_mean = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < to.size(); ++i) {
    const double weight = 1 / variance(i);
    weights += weight;
    to_mean += weight * to[i];
    from_mean += weight * from[i];
  }
  to_mean /= weights;
  from_mean /= weights;
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < to.size(); ++i)
    correlation += (to[i] - to_mean) * (from[i] - from_mean).transpose() / variance(i);
  const Eigen::Matrix3d rotation = nearest_rotation(correlation);
  return {rotation, to_mean - rotation * from_mean};
}

double translation_m(const Pose& pose) { return pose.translation.norm(); }

double rotation_rad(const Pose& pose) { return rotation_log(pose.rotation).norm(); }

}  // namespace fringeslam
