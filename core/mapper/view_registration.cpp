// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/view_registration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/registration/reference/engines.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

double displacement_sigma_m(const Pose& earlier_from_current, const Matrix6d& covariance, double distance_m) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -skew(earlier_from_current.rotation * Eigen::Vector3d(0, 0, distance_m)), Eigen::Matrix3d::Identity();
  return std::sqrt((jacobian * covariance * jacobian.transpose()).trace());
}

namespace {

// A change of viewpoint shifts the keypoints of a surface together, while ego-motion assumes independent errors. With
// little overlap, its errors are twice its sigmas.
Matrix6d covariance_of(const MotionEstimate& motion) {
  constexpr double kCorrelation = 4;
  return kCorrelation * motion.covariance;
}

// Largest displacement of surfaces when registration starts from the landmarks' motion: three sigmas of a point at the
// given distance, but at least a few times the depth noise. Wider gates pair objects with the background.
double start_error_m(const MotionEstimate& motion, double distance_m) {
  constexpr double kSigmas = 3, kLeast = 1e-3;
  return std::max(kLeast,
                  kSigmas * displacement_sigma_m(motion.previous_from_current, covariance_of(motion), distance_m));
}

// Factor by which residuals exceed their sigmas, as variances.
double excess(const IcpResult& icp) { return std::max(1.0, icp.rms_sigma * icp.rms_sigma); }

void take(ViewRegistration& result, const IcpResult& icp) {
  result.found = result.refined = true;
  result.earlier_from_current = orthonormalised(icp.target_from_source);
  result.covariance = excess(icp) * inverse(icp.information);
}

// True if the depth of both views agrees at a motion that registration did not refine, to within its uncertainty.
bool agrees_with_depth(const Frame& earlier, const Frame& current, const Pinhole& camera, double distance_m,
                       const MotionEstimate& motion) {
  constexpr double kLeastTolerance_m = 5e-3, kLeastOverlap = 0.05, kLeastAgreement = 0.6;
  const DepthAgreement depth = depth_agreement(earlier, current, camera, motion.previous_from_current,
                                               std::max(kLeastTolerance_m, start_error_m(motion, distance_m)));
  return depth.overlap >= kLeastOverlap && depth.agrees >= kLeastAgreement;
}

// Rejects a registration that other motions match equally well or that the views contradict.
void check_alternatives(const Frame& earlier, const Frame& current, const Pinhole& camera,
                        const AmbiguityOptions& options, const Admissible& admissible, ViewRegistration& result) {
  if (!options.detect || !result.found) return;
  AmbiguityReport report =
      find_alternatives(earlier, current, camera, result.earlier_from_current, options, admissible);
  // Poses within the covariance are no alternatives: the registration does not exclude them.
  std::erase_if(report.alternatives, [&](const AlternativePose& other) {
    return agree(other.target_from_source, result.earlier_from_current, result.covariance);
  });
  result.ambiguous = !report.alternatives.empty();
  result.alternatives = std::move(report.alternatives);
  if (result.ambiguous || report.contradicted) result.found = result.refined = false;
}

}  // namespace

bool agree(const Pose& pose, const Pose& other, const Matrix6d& covariance) {
  constexpr double kMaxSquare = 45;
  const Vector6d offset = difference(pose, other);
  return offset.dot(inverse(covariance) * offset) <= kMaxSquare;
}

std::vector<ViewMatches> matches_by_view(const std::vector<Recognition>& recognitions) {
  std::map<int, std::vector<KeypointMatch>> by_view;
  for (const Recognition& r : recognitions) {
    auto& matches = by_view[r.earlier_frame];
    matches.insert(matches.end(), r.matches.begin(), r.matches.end());
  }
  std::vector<ViewMatches> list;
  for (auto& [view, matches] : by_view) list.push_back({view, std::move(matches)});
  // Among equals, the latest comes first.
  std::stable_sort(list.begin(), list.end(), [](const ViewMatches& a, const ViewMatches& b) {
    return a.matches.size() != b.matches.size() ? a.matches.size() > b.matches.size() : a.earlier > b.earlier;
  });
  return list;
}

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
  result.covariance = covariance_of(result.motion);

  IcpOptions icp = options.icp;
  icp.max_distance_m = std::min(icp.max_distance_m, start_error_m(result.motion, distance_m));
  result.icp =
      options.tracking.engine == RegistrationEngine::point_to_plane
          ? point_to_plane_icp(earlier, current, camera, result.earlier_from_current, icp, inverse(result.covariance))
          : register_with_engine(options.tracking.engine, earlier, current, camera, result.earlier_from_current, icp);
  if (result.icp.converged &&
      agree(result.icp.target_from_source, result.motion.previous_from_current, covariance_of(result.motion)))
    take(result, result.icp);
  if (!result.refined) result.found = agrees_with_depth(earlier, current, camera, distance_m, result.motion);
  check_alternatives(earlier, current, camera, options.ambiguity, {}, result);
  return result;
}

ViewRegistration follow_view(const Frame& earlier, const Frame& current, const Pose& predicted, const Pinhole& camera,
                             double distance_m, const RegistrationOptions& options, const Matrix6d& prior,
                             const Matrix6d& predicted_covariance) {
  const TrackingOptions& limits = options.tracking;
  ViewRegistration result;
  IcpOptions icp = options.icp;
  icp.max_distance_m = std::min(icp.max_distance_m, limits.max_prediction_error_m);
  result.icp = point_to_plane_icp(earlier, current, camera, predicted, icp, prior);
  const IcpResult& found = result.icp;
  if (!found.converged || found.overlap < limits.min_overlap || found.consistency < limits.min_consistency ||
      found.rms_sigma > limits.max_rms_sigma || !(found.reopened_sigma <= limits.max_reopened_sigma))
    return result;
  const Eigen::Vector3d middle(0, 0, distance_m);
  const double spread_m = 0.5 * distance_m * std::hypot(camera.width / camera.fx, camera.height / camera.fy);
  const auto displacement_m = [&](const Pose& pose) { return (predicted * middle - pose * middle).norm(); };
  if (displacement_m(found.target_from_source) > limits.max_prediction_error_m) return result;
  result.undetermined =
      unobservable_directions(found.information / excess(found), found.target_from_source,
                              found.target_from_source * middle, spread_m, {limits.max_displacement_sigma_m});
  if (!result.undetermined.empty()) return result;
  take(result, found);

  // Sigmas of one axis. The true pose may lie at the limit.
  constexpr double kSigmas = 3, kOutside = 1.1;
  double gate_m = limits.max_prediction_error_m;
  const double known_m = kSigmas * displacement_sigma_m(predicted, predicted_covariance, distance_m) / std::sqrt(3.0);
  if (known_m > displacement_m(result.earlier_from_current)) gate_m = std::min(gate_m, known_m);
  if (gate_m > least_period_m(camera, distance_m))
    check_alternatives(
        earlier, current, camera, options.ambiguity,
        [&](const Pose& pose) { return displacement_m(pose) <= kOutside * gate_m; }, result);
  return result;
}

LocatedView locate_view(const std::function<SeenView(int)>& earlier, int last, const SeenView& current,
                        const std::vector<Recognition>& recognitions, const Pinhole& camera, double distance_m,
                        const RegistrationOptions& options) {
  constexpr size_t kMostViews = 3;
  LocatedView result;
  const auto attempt = [&](const SeenView& view, ViewMatches with) {
    ViewRegistration registration =
        register_views(view.frame, current.frame, point_pairs(view.keypoints, current.keypoints, with.matches), camera,
                       distance_m, options);
    const auto rank = [](const ViewRegistration& r) { return r.refined ? 3 : r.found ? 2 : r.ambiguous ? 1 : 0; };
    if (rank(registration) < rank(result.registration) || (result.registration.found && !registration.refined))
      return false;
    result = {std::move(with), std::move(registration)};
    return result.registration.refined;
  };
  if (options.tracking.correspondences == Correspondences::landmarks) {
    std::vector<ViewMatches> candidates = matches_by_view(recognitions);
    candidates.resize(std::min(candidates.size(), kMostViews));
    for (ViewMatches& with : candidates) {
      const int number = with.earlier;
      if (attempt(earlier(number), std::move(with))) break;
    }
  }
  // A pose that is ambiguous from that view's landmarks is ambiguous from all its keypoints, too.
  if (!result.registration.refined && !(result.registration.ambiguous && result.with.earlier == last)) {
    const SeenView view = earlier(last);
    attempt(view, {last, match_keypoints(view.keypoints, current.keypoints, options.matching)});
  }
  return result;
}

Matrix6d with_parallax(const Matrix6d& covariance, const Pose& a_from_b, double distance_m,
                       std::optional<double> corrected_spread_px2) {
  // Measured on views 0.01 to 0.8 distances apart. The variance that the correction leaves grows with the square of the spread's.
  constexpr double kUncorrectedNear = 0.8, kUncorrectedPerDistance = 4;
  constexpr double kNear = 0.9, kPerDistance = 0.65, kMeasuredSpread_px2 = 1.0 / 12 + 0.09 * 0.09;
  double near = kUncorrectedNear, per_distance = kUncorrectedPerDistance;
  if (corrected_spread_px2) {
    const double wider = *corrected_spread_px2 / kMeasuredSpread_px2;
    near = kNear, per_distance = kPerDistance * wider * wider;
  }
  return std::max(1.0, near * (1 + per_distance * a_from_b.translation.norm() / distance_m)) * covariance;
}

}  // namespace fringeslam
