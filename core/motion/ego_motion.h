// SPDX-License-Identifier: Apache-2.0
// Ego-motion from matched 3D points (docs/method.md, section 6; thesis 4.1.2).
//
// Hypotheses from three pairs each are ranked by r = l / m, the share of the m pairs that support them; the best one
// is accepted if r > b. It is then refined by Levenberg-Marquardt over its l inliers,
//
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/motion/observability.h"
#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

// One matched point, in the camera frames of the previous and the current view.
struct PointPair {
  Eigen::Vector3d previous, current;                        // m
  Eigen::Matrix3d previous_covariance, current_covariance;  // m^2
};

struct MotionOptions {
  double min_rank = 0.1;  // b
  int min_inliers = 8;
  double inlier_sigma = 4;  // largest Mahalanobis distance of an inlier pair
  int max_hypotheses = 20000;
  double max_rotation_sigma_deg = 1;  // if exceeded, the motion counts as not determined
  double max_translation_sigma_m = 0.01;
  int seed = 1;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("min_rank", min_rank, {0, 1}, "least share b of inlier pairs, r = l/m > b");
    v.field("min_inliers", min_inliers, {3, 10000}, "least number of inlier pairs");
    v.field("inlier_sigma", inlier_sigma, {0.1, 100}, "largest Mahalanobis distance of an inlier pair");
    v.field("max_hypotheses", max_hypotheses, {1, 10000000}, "largest number of hypotheses (triples of pairs)");
    v.field("max_rotation_sigma_deg", max_rotation_sigma_deg, {1e-6, 180},
            "largest sigma of a determined rotation, degrees");
    v.field("max_translation_sigma_m", max_translation_sigma_m, {1e-9, 100},
            "largest sigma of a determined translation, m");
    v.field("seed", seed, {0, 2147483647}, "seed of the random choice of triples");
  }
};

enum class MotionStatus { determined, too_few_pairs, no_consensus, degenerate };
std::string to_string(MotionStatus status);

struct MotionEstimate {
  MotionStatus status = MotionStatus::too_few_pairs;
  Pose previous_from_current;
  Matrix6d covariance = Matrix6d::Zero();  // in the tangent (omega, v) of retract()
  int pairs = 0, inliers = 0;
  double rank = 0;  // l / m
  int iterations = 0;
  std::vector<char> is_inlier;  // for each pair
  std::vector<UnobservableDirection>
      undetermined;  // if degenerate: unconstrained directions, in the previous camera's frame
};

// Estimates the motion of the camera from matched points. Pairs that are not finite, or whose summed covariance is
// singular, are ignored and not counted in `pairs`. Throws Error for options out of range.
MotionEstimate estimate_motion(const std::vector<PointPair>& pairs, const MotionOptions& options);

}  // namespace fringeslam
