// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/view_registration.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/map/engines.h"

namespace fringeslam {

namespace {

// How far off surfaces may be when registration starts from the landmarks' motion: six sigmas of a point at the given
// distance, and not less than a few times what depth noise does. Wider, registration would pair things with what
// stands behind them.
double start_error_m(const MotionEstimate& motion, double distance_m) {
  constexpr double kSigmas = 6, kLeast = 1e-3;
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -skew(motion.previous_from_current.rotation * Eigen::Vector3d(0, 0, distance_m)),
      Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d covariance = jacobian * motion.covariance * jacobian.transpose();
  return std::max(kLeast, kSigmas * std::sqrt(covariance.trace()));
}

// Whether registration stayed within what the landmarks' covariance allows (chi-square of six degrees of freedom, one
// false alarm in 10^7): it refines their motion, it does not overrule it.
bool agree(const Pose& refined, const MotionEstimate& motion) {
  constexpr double kMaxSquare = 45;
  const Vector6d offset = difference(refined, motion.previous_from_current);
  return offset.dot(motion.covariance.inverse() * offset) <= kMaxSquare;
}

// Residuals wider than the sigmas say that the sigmas are too small, by as much.
double excess(const IcpResult& icp) { return std::max(1.0, icp.rms_sigma * icp.rms_sigma); }

void take(ViewRegistration& result, const IcpResult& icp) {
  result.found = result.refined = true;
  result.earlier_from_current = orthonormalised(icp.target_from_source);
  result.covariance = excess(icp) * icp.information.inverse();
}

}  // namespace

std::vector<PointPair> point_pairs(const Keypoints& earlier, const Keypoints& current,
                                   const std::vector<KeypointMatch>& matches) {
  std::vector<PointPair> pairs;
  for (const KeypointMatch& match : matches) {
    const Keypoint& e = earlier.keypoints[static_cast<size_t>(match.earlier)];
    const Keypoint& c = current.keypoints[static_cast<size_t>(match.current)];
    pairs.push_back({e.point_m, c.point_m, e.covariance_m2, c.covariance_m2});
  }
  return pairs;
}

ViewRegistration register_views(const Frame& earlier, const Frame& current, const std::vector<PointPair>& pairs,
                                const Pinhole& camera, double distance_m, const RegistrationOptions& options) {
  ViewRegistration result;
  result.motion = estimate_motion(pairs, options.motion);
  if (result.motion.status != MotionStatus::determined) return result;
  result.found = true;
  result.earlier_from_current = result.motion.previous_from_current;
  result.covariance = result.motion.covariance;

  IcpOptions icp = options.icp;
  icp.max_distance_m = std::min(icp.max_distance_m, start_error_m(result.motion, distance_m));
  result.icp = options.tracking.engine == "point_to_plane"
                   ? point_to_plane_icp(earlier, current, camera, result.earlier_from_current, icp,
                                        result.motion.covariance.inverse())
                   : register_by(options.tracking.engine, earlier, current, camera, result.earlier_from_current, icp);
  if (result.icp.converged && agree(result.icp.target_from_source, result.motion)) take(result, result.icp);
  return result;
}

ViewRegistration follow_view(const Frame& earlier, const Frame& current, const Pose& predicted, const Pinhole& camera,
                             double distance_m, const RegistrationOptions& options, const Matrix6d& prior) {
  const TrackingOptions& limits = options.tracking;
  ViewRegistration result;
  IcpOptions icp = options.icp;
  icp.max_distance_m = std::min(icp.max_distance_m, limits.max_prediction_error_m);
  result.icp = point_to_plane_icp(earlier, current, camera, predicted, icp, prior);
  const IcpResult& found = result.icp;
  if (!found.converged || found.overlap < limits.min_overlap || found.consistency < limits.min_consistency ||
      found.rms_sigma > limits.max_rms_sigma)
    return result;
  const Eigen::Vector3d middle(0, 0, distance_m);
  const double spread_m = 0.5 * distance_m * std::hypot(camera.width / camera.fx, camera.height / camera.fy);
  if ((predicted * middle - found.target_from_source * middle).norm() > limits.max_prediction_error_m) return result;
  result.undetermined = free_directions(found.information / excess(found), found.target_from_source,
                                        found.target_from_source * middle, spread_m, {limits.max_displacement_sigma_m});
  if (!result.undetermined.empty()) return result;
  take(result, found);
  return result;
}

}  // namespace fringeslam
