// SPDX-License-Identifier: Apache-2.0
#include "core/motion/observability.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kNegligible = 0.05;  // largest share of rotation in a translation, and of advance in a rotation
constexpr double kZero = 1e-12;       // relative to the largest eigenvalue

// These matrices have at most six rows; lazyProduct() multiplies them without Eigen's blocked kernel, which takes long to
// compile.

// Returns an orthonormal basis of the span of the columns; each vector is as near to an axis of the frame as the
// previous ones permit.
std::vector<Vector3d> nearest_axes(const MatrixXd& columns) {
  const MatrixXd basis = thin_svd(columns).u;
  Matrix3d span = basis.lazyProduct(basis.transpose());
  std::vector<Vector3d> axes;
  for (Eigen::Index i = 0; i < columns.cols(); ++i) {
    int nearest = 0;
    for (int axis = 1; axis < 3; ++axis) {
      if (span(axis, axis) > span(nearest, nearest) + 1e-6) nearest = axis;  // ties up to rounding: the first axis
    }
    axes.push_back(span.col(nearest).normalized());
    span -= axes.back() * axes.back().transpose();
  }
  return axes;
}

// Returns the combinations of the twists (omega; u), six rows each, that are principal screws.
std::vector<VectorXd> principal_screws(const MatrixXd& twists, double lever) {
  const MatrixXd omega = twists.topRows(3), advance = omega.transpose().lazyProduct(twists.bottomRows(3));
  const auto pitches = generalized_eigen((advance + advance.transpose()) / 2, omega.transpose().lazyProduct(omega));
  std::vector<VectorXd> result;
  if (pitches.values.maxCoeff() - pitches.values.minCoeff() > kNegligible * lever) {
    for (Eigen::Index i = 0; i < twists.cols(); ++i) result.push_back(pitches.vectors.col(i));
  } else {
    for (const Vector3d& axis : nearest_axes(omega)) result.push_back(least_squares(omega, axis));
  }
  return result;
}

// Returns the point nearest to all axes, or `centre` along directions that they leave open.
Vector3d common_point(const std::vector<UnobservableDirection>& axes, const Vector3d& centre) {
  Matrix3d sum = 1e-9 * Matrix3d::Identity();
  Vector3d moment = Vector3d::Zero();
  for (const UnobservableDirection& axis : axes) {
    const Matrix3d across = Matrix3d::Identity() - axis.axis * axis.axis.transpose();
    sum += across;
    moment += across * (axis.point_m - centre);
  }
  return centre + solve_positive_definite(sum, moment);
}

std::string text_of(const Vector3d& v, int digits) {
  char text[96];
  const double step = std::pow(10, -digits);
  const auto rounded = [&](double x) { return std::abs(x) < step / 2 ? 0.0 : x; };  // never -0.00
  std::snprintf(text, sizeof text, "(%.*f, %.*f, %.*f)", digits, rounded(v.x()), digits, rounded(v.y()), digits,
                rounded(v.z()));
  return text;
}

}  // namespace

std::string to_string(const UnobservableDirection& direction) {
  const std::string axis = text_of(direction.axis, 2);
  if (direction.kind == FreeKind::translation) return "slides along " + axis;
  const std::string line = "turns about " + axis + " through " + text_of(direction.point_m, 3) + " m";
  if (direction.kind == FreeKind::rotation) return line;
  char advance[48];
  std::snprintf(advance, sizeof advance, ", advancing %.1f mm per radian", 1e3 * direction.pitch_m);
  return line + advance;
}

std::vector<UnobservableDirection> unobservable_directions(const Matrix6d& information, const Pose& target_from_source,
                                                           const Vector3d& centre_m, double spread_m,
                                                           const ObservabilityOptions& options) {
  check_options(options, "observability");
  if (!information.allFinite() || !target_from_source.is_finite() || !centre_m.allFinite() || !(spread_m >= 0) ||
      std::isinf(spread_m))
    throw Error("observability: information, pose, centre and spread must be finite");
  const double lever = spread_m > 0 ? spread_m : 1;
  Matrix6d tangent_from_z = Matrix6d::Identity();
  tangent_from_z.topLeftCorner<3, 3>() /= lever;
  tangent_from_z.bottomLeftCorner<3, 3>() = skew(centre_m - target_from_source.translation) / lever;
  const Matrix6d of_z = tangent_from_z.transpose() * information * tangent_from_z;
  const SymmetricEigen<6> eigen = symmetric_eigen(Matrix6d((of_z + of_z.transpose()) / 2));
  Vector6d held = eigen.values;  // ascending
  for (double& value : held) value = value <= kZero * held[5] ? 0 : value;
  const double limit = std::pow(options.max_displacement_sigma_m, -2);
  const Eigen::Index free = (held.array() < limit).count();
  if (free == 0) return {};

  const MatrixXd span = eigen.vectors.leftCols(free);
  // In m; `combination` has unit length and refers to the columns of `span`.
  const auto sigma = [&](const VectorXd& combination) {
    return 1 / std::sqrt(combination.cwiseAbs2().dot(held.head(free)));
  };
  const SingularValues turning = full_svd(span.topRows(3));
  const Eigen::Index turns = (turning.values.array() > kNegligible).count();
  std::vector<UnobservableDirection> result;

  const MatrixXd slides = turning.v.rightCols(free - turns);
  if (slides.cols() > 0) {
    const MatrixXd shifts = span.bottomRows(3).lazyProduct(slides);
    for (const Vector3d& axis : nearest_axes(shifts))
      result.push_back({FreeKind::translation, axis, Vector3d::Zero(), 0,
                        sigma((slides * (shifts.transpose() * axis)).normalized())});
  }
  if (turns == 0) return result;

  const MatrixXd rest = turning.v.leftCols(turns);
  MatrixXd twists = span.lazyProduct(rest);
  twists.topRows(3) /= lever;
  std::vector<UnobservableDirection> turned;
  for (const VectorXd& screw : principal_screws(twists, lever)) {
    const Vector6d twist = twists * screw;
    const double rad = twist.head<3>().norm();
    Eigen::Index largest;
    twist.head<3>().cwiseAbs().maxCoeff(&largest);
    const double sign = twist[largest] < 0 ? -1 : 1;
    const Vector3d axis = sign * twist.head<3>() / rad, shift = sign * twist.tail<3>() / rad;
    const double pitch = axis.dot(shift);
    const bool advances = std::abs(pitch) > kNegligible * lever;
    turned.push_back({advances ? FreeKind::screw : FreeKind::rotation, axis, centre_m + axis.cross(shift),
                      advances ? pitch : 0, sigma(rest * screw.normalized()) * rad / screw.norm()});
  }
  const Vector3d common = common_point(turned, centre_m);
  for (UnobservableDirection& direction : turned) {
    direction.point_m += direction.axis * direction.axis.dot(common - direction.point_m);
    result.push_back(direction);
  }
  return result;
}

}  // namespace fringeslam
