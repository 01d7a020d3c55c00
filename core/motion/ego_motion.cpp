// SPDX-License-Identifier: Apache-2.0
#include "core/motion/ego_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "core/base/ransac.h"
#include "core/motion/refine.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

bool usable(const PointPair& pair) {
  return pair.previous.allFinite() && pair.current.allFinite() && pair.previous_covariance.allFinite() &&
         pair.current_covariance.allFinite() &&
         is_positive_definite(Eigen::Matrix3d(pair.previous_covariance + pair.current_covariance));
}

double mahalanobis2(const PointPair& pair, const Pose& previous_from_current) {
  const Eigen::Vector3d residual = pair.previous - previous_from_current * pair.current;
  return residual.dot(solve_positive_definite(pair_covariance(pair, previous_from_current), residual));
}

struct Support {
  std::vector<char> is_inlier;
  int count = 0;
  double cost = 0;  // truncated sum of squares; breaks ties between equal counts
};

Support support_of(const Pose& hypothesis, const std::vector<PointPair>& pairs, double inlier_sigma) {
  Support support;
  support.is_inlier.resize(pairs.size());
  const double limit = inlier_sigma * inlier_sigma;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const double d2 = mahalanobis2(pairs[i], hypothesis);
    support.is_inlier[i] = d2 <= limit;
    support.count += support.is_inlier[i];
    support.cost += std::min(d2, limit);
  }
  return support;
}

// A rigid motion preserves distances, so triples that violate this are rejected. This discards most wrong triples for
// the cost of three square roots.
bool congruent(const std::vector<PointPair>& pairs, const std::array<size_t, 3>& triple, double inlier_sigma) {
  for (size_t i = 0; i < 3; ++i) {
    const PointPair& a = pairs[triple[i]];
    const PointPair& b = pairs[triple[(i + 1) % 3]];
    const double spread = std::sqrt(a.previous_covariance.trace() + a.current_covariance.trace() +
                                    b.previous_covariance.trace() + b.current_covariance.trace());
    const double previous = (a.previous - b.previous).norm();
    if (std::abs(previous - (a.current - b.current).norm()) > inlier_sigma * spread) return false;
    if (previous < 4 * spread) return false;  // too close together to determine a rotation
  }
  return true;
}

struct Hypothesis {
  Pose pose;
  Support support;
  int inliers() const { return support.count; }
};

std::optional<Hypothesis> best_hypothesis(const std::vector<PointPair>& pairs, const MotionOptions& options) {
  const auto fit = [&](size_t i, size_t j, size_t k) -> std::optional<Hypothesis> {
    const std::array<size_t, 3> triple = {i, j, k};
    if (!congruent(pairs, triple, options.inlier_sigma)) return std::nullopt;
    std::vector<Eigen::Vector3d> previous, current;
    for (const size_t item : triple) {
      previous.push_back(pairs[item].previous);
      current.push_back(pairs[item].current);
    }
    const Pose pose = align_points(previous, current);
    // A motion from three noisy points has large errors at distant points, so the inlier limit is doubled here.
    return Hypothesis{pose, support_of(pose, pairs, 2 * options.inlier_sigma)};
  };
  const auto better = [](const Hypothesis& a, const Hypothesis& b) {
    return a.support.count > b.support.count || (a.support.count == b.support.count && a.support.cost < b.support.cost);
  };
  const RansacOptions search{.max_triples = options.max_hypotheses, .seed = static_cast<uint64_t>(options.seed)};
  return best_of_triples(pairs.size(), search, fit, better);
}

// Returns the directions that `options` classify as undetermined; the lever arm combines their two limits into one. If
// the scene's position at the inliers' centroid is determined, the camera's own position, far from the scene, is not.
std::vector<UnobservableDirection> undetermined(const std::vector<PointPair>& pairs, const MotionEstimate& estimate,
                                                const Matrix6d& information, const MotionOptions& options) {
  const double lever_m = options.max_translation_sigma_m / (options.max_rotation_sigma_deg * std::numbers::pi / 180);
  const Pose& pose = estimate.previous_from_current;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (estimate.is_inlier[i]) centre += pose * pairs[i].current / estimate.inliers;
  }
  const ObservabilityOptions limits{.max_displacement_sigma_m = options.max_translation_sigma_m};
  std::vector<UnobservableDirection> directions = unobservable_directions(information, pose, centre, lever_m, limits);
  if (directions.empty()) directions = unobservable_directions(information, pose, pose.translation, lever_m, limits);
  return directions;
}

MotionEstimate estimate_from(const std::vector<PointPair>& pairs, const MotionOptions& options) {
  MotionEstimate result;
  result.pairs = static_cast<int>(pairs.size());
  result.is_inlier.assign(pairs.size(), 0);
  if (result.pairs < std::max(3, options.min_inliers)) return result;

  result.status = MotionStatus::no_consensus;
  const std::optional<Hypothesis> best = best_hypothesis(pairs, options);
  if (!best) return result;
  Pose pose = best->pose;
  Support support = best->support;
  Matrix6d information = Matrix6d::Zero();
  // Inliers and pose usually converge within a few rounds.
  for (int round = 0; round < 5; ++round) {
    if (support.count < 3) return result;
    const Refinement refined = refine_motion(pairs, support.is_inlier, pose);
    result.iterations += refined.iterations;
    pose = refined.previous_from_current;
    result.covariance = refined.covariance;
    information = refined.information;
    Support next = support_of(pose, pairs, options.inlier_sigma);
    const bool settled = next.is_inlier == support.is_inlier;
    support = std::move(next);
    if (settled) break;
  }
  result.previous_from_current = pose;
  result.is_inlier = support.is_inlier;
  result.inliers = support.count;
  result.rank = static_cast<double>(support.count) / static_cast<double>(pairs.size());
  if (support.count < options.min_inliers || result.rank <= options.min_rank) return result;

  const auto worst = [&](int corner) {
    const Eigen::Matrix3d block = result.covariance.block<3, 3>(corner, corner);
    return std::sqrt(symmetric_eigen(block).values.maxCoeff());
  };
  const bool determined = result.covariance.allFinite() &&
                          worst(0) <= options.max_rotation_sigma_deg * std::numbers::pi / 180 &&
                          worst(3) <= options.max_translation_sigma_m;
  result.status = determined ? MotionStatus::determined : MotionStatus::degenerate;
  if (!determined) result.undetermined = undetermined(pairs, result, information, options);
  return result;
}

}  // namespace

std::string to_string(MotionStatus status) {
  switch (status) {
    case MotionStatus::determined:
      return "determined";
    case MotionStatus::too_few_pairs:
      return "too few pairs";
    case MotionStatus::no_consensus:
      return "no consensus";
    case MotionStatus::degenerate:
      return "degenerate";
  }
  return "unknown";
}

Eigen::Matrix3d pair_covariance(const PointPair& pair, const Pose& previous_from_current) {
  const Eigen::Matrix3d& r = previous_from_current.rotation;
  return pair.previous_covariance + r * pair.current_covariance * r.transpose();
}

MotionEstimate estimate_motion(const std::vector<PointPair>& pairs, const MotionOptions& options) {
  check_options(options, "motion");
  std::vector<size_t> which;
  std::vector<PointPair> usable_pairs;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!usable(pairs[i])) continue;
    which.push_back(i);
    usable_pairs.push_back(pairs[i]);
  }
  MotionEstimate result = estimate_from(usable_pairs, options);
  std::vector<char> is_inlier(pairs.size(), 0);
  for (size_t i = 0; i < which.size(); ++i) is_inlier[which[i]] = result.is_inlier[i];
  result.is_inlier = std::move(is_inlier);
  return result;
}

}  // namespace fringeslam
