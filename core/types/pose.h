// SPDX-License-Identifier: Apache-2.0
// Rigid transforms in 3D and their six-parameter representation used in the papers.
//
// A Pose is named `a_from_b`: x_a = a_from_b * x_b. Frames are right-handed; the camera's x axis points right, y down,
// z forward. Tangent vectors are (omega, v): rotation in rad first, translation in m.
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

// Returns the skew-symmetric matrix of v: skew(v) * w = v x w.
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

// Rotation by |omega| rad about omega (Rodrigues' formula) and its inverse, with |omega| <= pi.
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& omega);
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation);

// Decoupled retraction used throughout the project: rotation and translation of `pose` are perturbed separately from
// the left, R' = Exp(omega) R, t' = t + v.
Pose retract(const Pose& pose, const Vector6d& tangent);

// Returns the tangent for which retract(from, tangent) == to.
Vector6d difference(const Pose& to, const Pose& from);

// Returns the 6 x 6 matrix that rotates both parts of a tangent.
Matrix6d rotated_tangent(const Eigen::Matrix3d& rotation);

// Returns the covariance of a tangent whose two parts are rotated.
Matrix6d rotated_covariance(const Eigen::Matrix3d& rotation, const Matrix6d& covariance);

// Returns the derivative of the tangent of a * b with respect to that of a, both of retract(), given the lever a.rotation *
// b.translation: omega' = omega, v' = v + omega x lever.
Matrix6d tangent_of_product(const Eigen::Vector3d& lever);

// Returns the derivative of the tangent of pose.inverse() with respect to that of pose, both of retract(): omega' = -R^T
// omega, v' = -R^T (v + t x omega).
Matrix6d tangent_of_inverse(const Pose& pose);

// Returns the covariance of pose.inverse() given that of pose, both in the tangent space of retract().
Matrix6d covariance_of_inverse(const Pose& pose, const Matrix6d& covariance);

// Replaces the rotation by the nearest one, to remove rounding drift from long products.
Pose orthonormalised(const Pose& pose);

// Conversion to and from a unit quaternion (x, y, z, w) with w >= 0, as stored in TUM trajectory files.
Eigen::Vector4d quaternion_xyzw(const Eigen::Matrix3d& rotation);
Eigen::Matrix3d rotation_from_quaternion(const Eigen::Vector4d& xyzw);

// Six-parameter pose of the papers (thesis 5.2, paper IV): translation in mm and the angles of R = Rz(gamma) Ry(beta)
// Rx(alpha) in degrees.
struct SixDof {
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d angles_deg = Eigen::Vector3d::Zero();  // alpha, beta, gamma
};

SixDof six_dof(const Pose& pose);
Pose pose_from(const SixDof& six);

// Returns the rigid transform T = to_from_from that minimises sum |to_i - T from_i|^2 / variances_i (Umeyama 1991,
// without scale); empty variances are all equal. Requires at least one pair; with fewer than three or with collinear
// points the rotation is not unique and an arbitrary solution is returned.
Pose align_points(const std::vector<Eigen::Vector3d>& to, const std::vector<Eigen::Vector3d>& from,
                  const std::vector<double>& variances = {});

// Magnitudes of a motion: |t| in m and the rotation angle in rad.
double translation_m(const Pose& pose);
double rotation_rad(const Pose& pose);

}  // namespace fringeslam
