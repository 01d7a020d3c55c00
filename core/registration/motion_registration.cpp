// SPDX-License-Identifier: Apache-2.0
#include "core/registration/motion_registration.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Eigen::Vector3d;
using Vector18d = Eigen::Matrix<double, 18, 1>;
using Matrix18d = Eigen::Matrix<double, 18, 18>;

struct Sums {
  Matrix18d information = Matrix18d::Zero();
  Vector18d gradient = Vector18d::Zero();
  double squares = 0;
  int pairs = 0;
};

// Adds the slopes [first, end); see linearise().
void add_slopes(const Frame& target, const Frame& source, const Pinhole& camera, double largest_r2, const Pose& pose,
                const std::vector<DepthSlope>& slopes, size_t first, size_t end, const Vector12d& step,
                const Matrix12d& uncertain, double outlier_sigma, Sums& sums) {
  constexpr double kMinCosine = 0.85;
  Eigen::Vector2d pixel;
  Vector18d jacobian;
  for (size_t i = first; i < end; ++i) {
    const DepthSlope& slope = slopes[i];
    const Vector3d normal = vector_of(source.normals(slope.row, slope.col));
    if (std::isnan(normal.z())) continue;
    const Vector3d seen = vector_of(source.points_m(slope.row, slope.col)), ray = seen / seen.z();
    const Vector3d point = seen + slope.by_motion.dot(step) * ray;
    const Vector3d turned = pose.rotation * point, moved = turned + pose.translation;
    if (!camera.shows(moved, largest_r2, pixel)) continue;
    const int row = static_cast<int>(pixel.y() + 0.5), col = static_cast<int>(pixel.x() + 0.5);
    const Vector3d there = vector_of(target.points_m(row, col)), facing = vector_of(target.normals(row, col));
    if (std::isnan(there.z()) || std::isnan(facing.z())) continue;
    const Vector3d own = pose.rotation * normal;
    if (own.dot(facing) < kMinCosine) continue;
    const Vector3d mean = (own + facing).normalized();
    const double by_depth = mean.dot(pose.rotation * ray), by_target = mean.dot(there) / there.z();
    const double own_sigma = by_depth * static_cast<double>(source.sigma_m(slope.row, slope.col)),
                 target_sigma = by_target * static_cast<double>(target.sigma_m(row, col));
    const double variance = own_sigma * own_sigma + target_sigma * target_sigma;
    const double residual = mean.dot(moved - there);
    const double gate = outlier_sigma * outlier_sigma *
                        (variance + by_depth * by_depth * slope.by_motion.dot(uncertain * slope.by_motion));
    const double left = 1 - residual * residual / gate;
    if (left <= 0) continue;
    const double weight = left * left / variance;
    jacobian << turned.cross(mean), mean, by_depth * slope.by_motion;
    sums.information.selfadjointView<Eigen::Lower>().rankUpdate(jacobian, weight);
    sums.gradient += weight * residual * jacobian;
    sums.squares += residual * residual / variance;
    ++sums.pairs;
  }
}

// `uncertain`: the variance of a depth given that of the motion widens the gates.
Sums linearise(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& pose,
               const std::vector<DepthSlope>& slopes, const Vector12d& step, const Matrix12d& uncertain,
               double outlier_sigma) {
  // The parts do not depend on the number of threads, nor does their sum.
  constexpr size_t kPart = 512;
  std::vector<Sums> parts((slopes.size() + kPart - 1) / kPart);
  const double largest_r2 = camera.largest_r2();
  for_each_row(static_cast<int>(parts.size()), [&](int number) {
    const auto part = static_cast<size_t>(number);
    add_slopes(target, source, camera, largest_r2, pose, slopes, part * kPart,
               std::min(slopes.size(), (part + 1) * kPart), step, uncertain, outlier_sigma, parts[part]);
  });
  Sums sums;
  for (const Sums& part : parts) {
    sums.information += part.information;
    sums.gradient += part.gradient;
    sums.squares += part.squares;
    sums.pairs += part.pairs;
  }
  sums.information.triangularView<Eigen::StrictlyUpper>() = sums.information.transpose();
  return sums;
}

Matrix6x12d derivative_of_pose(const Matrix18d& information) {
  const Matrix6d pose = information.topLeftCorner<6, 6>();
  return -inverse(pose) * information.topRightCorner<6, 12>();
}

constexpr int kLeastMotionPairs = 200;
constexpr double kMaxResidualSigmas = 6;

}  // namespace

Matrix6x12d pose_by_motion(const Frame& target, const Frame& source, const Pinhole& camera,
                           const Pose& target_from_source, const std::vector<DepthSlope>& slopes) {
  const Sums sums = linearise(target, source, camera, target_from_source, slopes, Vector12d::Zero(), Matrix12d::Zero(),
                              kMaxResidualSigmas);
  if (sums.pairs < kLeastMotionPairs) return Matrix6x12d::Zero();
  return derivative_of_pose(sums.information);
}

MotionRegistration register_motion(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                                   const std::vector<DepthSlope>& slopes, const CameraMotion& current,
                                   const MotionPrior& prior) {
  constexpr int kIterations = 8;
  constexpr double kSettledSigmas = 0.1, kScaleSettled = 1.2;
  constexpr int kScaleIterations = 20;
  // Directions, as many as the motion has, that count as having agreed with the prior before. The depths of a view in
  // smooth motion determine few directions and none better than the prior, so that the likelihood of the scale is flat:
  // one error of 3.5 sigmas in a hundred views would free the whole motion.
  constexpr double kAgreed = 12;
  const Matrix12d prior_information = inverse_positive_definite(Eigen::MatrixXd(prior.covariance));
  const Vector12d from_prior = to_vector(current) - to_vector(prior.motion);
  MotionRegistration result;
  result.target_from_source = initial;
  // Most probable factor of the prior's covariance, by expectation maximisation: a motion that contradicts the prior in the
  // directions that the depth determines reduces confidence in the prior in the other directions, too.
  double scale = 1;
  // The motion is uncertain at first, then known. A narrow prior hardly widens the gates.
  constexpr double kNarrow = 5e-3;  // m/s or rad/s
  const bool is_narrow = prior.covariance.diagonal().head<6>().maxCoeff() < kNarrow * kNarrow;
  Matrix12d uncertain = prior.covariance;
  Matrix18d information;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Sums sums = linearise(target, source, camera, result.target_from_source, slopes, result.step, uncertain,
                          kMaxResidualSigmas);
    result.pairs = sums.pairs;
    if (sums.pairs < kLeastMotionPairs) return result;
    const double excess = std::max(1.0, sums.squares / sums.pairs);
    const Matrix18d measured = sums.information / excess;
    const Vector18d gradient = sums.gradient / excess;
    const auto solved = [&] {
      information = measured;
      information.bottomRightCorner<12, 12>() += prior_information / scale;
      Vector18d right = gradient;
      right.tail<12>() += prior_information * (from_prior + result.step) / scale;
      return Vector18d(solve_positive_definite(Eigen::MatrixXd(information), Eigen::VectorXd(-right)));
    };
    Vector18d step = solved();
    for (int i = 0; i < kScaleIterations && step.allFinite(); ++i) {
      const Vector12d off = from_prior + result.step + step.tail<12>();
      const Matrix12d left = inverse_positive_definite(Eigen::MatrixXd(information)).bottomRightCorner<12, 12>();
      const double squares = off.dot(prior_information * off) + (prior_information * left).trace();
      const double found = std::max(1.0, (kAgreed + squares) / (kAgreed + 12));
      const bool settled = found < kScaleSettled * scale;
      scale = std::max(scale, found);
      if (settled) break;
      step = solved();
    }
    if (!step.allFinite()) return result;
    result.target_from_source = retract(result.target_from_source, step.head<6>());
    result.step += step.tail<12>();
    uncertain *= 0.1;
    const bool gates_settled = iteration > 2 || is_narrow;
    if (gates_settled && std::sqrt(step.dot(information * step)) < kSettledSigmas) break;
  }
  const Matrix18d covariance = inverse_positive_definite(Eigen::MatrixXd(information));
  result.motion_covariance = covariance.bottomRightCorner<12, 12>();
  result.pose_by_motion = derivative_of_pose(information);
  result.prior_scale = scale;
  double squares = 0;
  for (const DepthSlope& slope : slopes) {
    const double change = slope.by_motion.dot(result.step) / static_cast<double>(source.sigma_m(slope.row, slope.col));
    squares += change * change;
  }
  result.ripple_sigma = std::sqrt(squares / static_cast<double>(std::max<size_t>(1, slopes.size())));
  result.valid = true;
  return result;
}

}  // namespace fringeslam
