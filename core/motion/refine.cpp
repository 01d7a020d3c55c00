// SPDX-License-Identifier: Apache-2.0
#include "core/motion/refine.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <limits>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

// Whitened residual of one pair under retract(initial, tangent).
struct PairResidual {
  Eigen::Vector3d previous, rotated_current;  // R0 q
  Eigen::Vector3d translation;                // t0
  Eigen::Matrix3d whitening;

  template <class T>
  bool operator()(const T* tangent, T* residual) const {
    const T point[3] = {T(rotated_current.x()), T(rotated_current.y()), T(rotated_current.z())};
    T turned[3];
    ceres::AngleAxisRotatePoint(tangent, point, turned);
    Eigen::Matrix<T, 3, 1> difference;
    for (int i = 0; i < 3; ++i) difference[i] = T(previous[i]) - turned[i] - T(translation[i]) - tangent[3 + i];
    Eigen::Map<Eigen::Matrix<T, 3, 1>> out(residual);
    out = whitening.cast<T>() * difference;
    return true;
  }
};

}  // namespace

Refinement refine_motion(const std::vector<PointPair>& pairs, const std::vector<char>& use, const Pose& initial) {
  Vector6d tangent = Vector6d::Zero();
  ceres::Problem problem;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!use[i]) continue;
    const PointPair& pair = pairs[i];
    auto* residual = new PairResidual{pair.previous, initial.rotation * pair.current, initial.translation,
                                      whitening(pair_covariance(pair, initial))};
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PairResidual, 3, 6>(residual), new ceres::HuberLoss(2.5),
                             tangent.data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 30;
  options.function_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  Refinement result;
  result.previous_from_current = retract(initial, tangent);
  result.iterations = static_cast<int>(summary.iterations.size());
  // Evaluated at the result, which may be far from the start along an unconstrained direction.
  const Pose& pose = result.previous_from_current;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!use[i]) continue;
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian << -skew(pose.rotation * pairs[i].current), Eigen::Matrix3d::Identity();
    jacobian = whitening(pair_covariance(pairs[i], pose)) * jacobian;
    result.information += jacobian.transpose() * jacobian;
  }
  result.covariance = inverse_if_well_conditioned(result.information, 1e-14)
                          .value_or(Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN()));
  return result;
}

}  // namespace fringeslam
