// SPDX-License-Identifier: Apache-2.0
// Rigid transforms of 3-space and the six numbers in which the papers report them.
//
// A Pose is named `a_from_b`: x_a = a_from_b * x_b. Frames are right-handed; the camera's x points
// right, y down, z forward. Tangent vectors are (omega, v): rotation in rad first, translation in m.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  // m

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return rotation * point + translation; }
  Pose operator*(const Pose& other) const { return {rotation * other.rotation, *this * other.translation}; }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }
  bool is_finite() const { return rotation.allFinite() && translation.allFinite(); }
};

// Skew-symmetric matrix of v: skew(v) * w = v x w.
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

// Rotation by |omega| rad about omega (Rodrigues' formula), and its inverse with |omega| <= pi.
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& omega);
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation);

// Decoupled retraction, used everywhere in this project: the rotation and the translation of `pose`
// are each perturbed from the left, R' = Exp(omega) R, t' = t + v.
Pose retract(const Pose& pose, const Vector6d& tangent);

// The tangent with retract(from, difference) == to.
Vector6d difference(const Pose& to, const Pose& from);

// Covariance of pose.inverse() from that of pose, both in the tangent of retract(): omega' = -R^T omega,
// v' = -R^T (v + t x omega).
Matrix6d covariance_of_inverse(const Pose& pose, const Matrix6d& covariance);

// Removes rounding drift from a product of many rotations.
Pose orthonormalised(const Pose& pose);

// Unit quaternion (x, y, z, w) with w >= 0, as TUM trajectory files store it, and back.
Eigen::Vector4d quaternion_xyzw(const Eigen::Matrix3d& rotation);
Eigen::Matrix3d rotation_from_quaternion(const Eigen::Vector4d& xyzw);

// The papers' six numbers (thesis 5.2, paper IV): translation in millimetres and the angles of
// R = Rz(gamma) Ry(beta) Rx(alpha) in degrees.
struct SixDof {
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d angles_deg = Eigen::Vector3d::Zero();  // alpha, beta, gamma
};

SixDof six_dof(const Pose& pose);
Pose pose_from(const SixDof& six);

// The rigid transform to_from_from that minimises sum |to_i - T from_i|^2 (Umeyama 1991, without scale).
// Needs at least one pair; fewer than three, or collinear points, leave a rotation free (one is chosen).
Pose align_points(const std::vector<Eigen::Vector3d>& to, const std::vector<Eigen::Vector3d>& from);

// Size of a motion: |t| in m and the rotation angle in rad.
double translation_m(const Pose& pose);
double rotation_rad(const Pose& pose);

}  // namespace fringeslam
