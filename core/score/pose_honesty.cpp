// SPDX-License-Identifier: Apache-2.0
#include "core/score/pose_honesty.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

double displacement_m(const Pose& found, const Pose& truth, const RigModel& rig) {
  const Pinhole& camera = rig.camera;
  const double z = rig.middle_range_m();
  const double x = z * 0.5 * camera.width / camera.fx, y = z * 0.5 * camera.height / camera.fy;
  double largest = 0;
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, z), Eigen::Vector3d(x, y, z), Eigen::Vector3d(-x, y, z),
                                       Eigen::Vector3d(x, -y, z), Eigen::Vector3d(-x, -y, z)}) {
    const double off_m = (found * point - truth * point).norm();
    if (std::isnan(off_m)) return std::numeric_limits<double>::quiet_NaN();  // std::max would drop it
    largest = std::max(largest, off_m);
  }
  return largest;
}

}  // namespace

double PoseHonesty::sigmas() const { return std::sqrt(squared_sigmas); }

bool PoseHonesty::confidently_wrong() const {
  constexpr double kOff_m = 1e-3, kSigmas = 10;
  const bool covered = squared_sigmas >= 0 && squared_sigmas <= kSigmas * kSigmas;
  return !(off_m <= kOff_m) && !covered;
}

PoseHonesty pose_honesty(const Pose& estimate, const Pose& truth, const Matrix6d& covariance, const RigModel& rig) {
  const Vector6d error = difference(estimate, truth);
  const std::optional<Vector6d> solved = solve_well_conditioned(covariance, error, 0);
  const bool usable = solved && is_positive_definite(covariance);
  return {displacement_m(estimate, truth, rig), usable ? error.dot(*solved) : std::numeric_limits<double>::quiet_NaN()};
}

}  // namespace fringeslam
