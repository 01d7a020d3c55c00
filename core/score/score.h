// SPDX-License-Identifier: Apache-2.0
// Errors of depth and motion estimates against exact ground truth. Functions work on values; truth_files.h reads files.
#pragma once

#include <limits>
#include <vector>

#include "core/score/trajectory_score.h"
#include "core/types/frame.h"
#include "core/types/pattern_sequence.h"
#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

// Estimated values of a view that are scored; H x W, NaN where invalid.
struct DepthEstimate {
  cv::Mat1f depth_m, sigma_m, projector_column;
};

// Depth errors of a view; the error fields are NaN if no pixel could be compared.
struct DepthScore {
  int compared = 0;                                            // directly lit pixels with an estimate
  double median_m = std::numeric_limits<double>::quiet_NaN();  // of |error|
  double rms_m = std::numeric_limits<double>::quiet_NaN();
  double p99_m = std::numeric_limits<double>::quiet_NaN();  // 99th percentile of |error|
  double valid_fraction = 0;                                // share of the directly lit pixels that have an estimate
  double wrong_order =
      std::numeric_limits<double>::quiet_NaN();  // share of compared pixels more than half a fringe period off
  int spurious = 0;                              // estimates where there is no surface or no direct light
};

// Returns the finest period of the fringes and carriers, half of which separates fringe orders (docs/method.md, section 13); without
// any, that of the Gray code; infinity if no pattern carries a code.
double finest_period_px(const PatternSequence& sequence);

DepthScore score_depth(const DepthEstimate& estimate, const TruthFrame& truth, double finest_period_px);

// Fisher information of `previous_from_current` in the tangent of retract(), from the depth of both frames where they
// overlap (docs/method.md, section 7.2): J = sum g g^T / (sigma_A^2 + sigma_B^2), g = (R p x n, n), A the previous and
// B the current frame. Each sigma is that of the residual along the normal, |n.d| sigma_z. sigma_A^2 is multiplied by
// the number of points of B that fall on the same pixel of A, since averaging them does not reduce A's error. Mixed
// pixels (kTruthMixed) are excluded because their error is neither zero-mean nor described by sigma. Geometry is
// ground truth, sigmas are the estimated ones.
Matrix6d pose_information(const TruthFrame& previous, const cv::Mat1f& previous_sigma_m, const TruthFrame& current,
                          const cv::Mat1f& current_sigma_m, const Pinhole& camera, const PixelRays& rays,
                          const Pose& true_previous_from_current);

// sqrt(e^T J e / 6), where e is the tangent vector from truth to estimate: about 1 for an estimator at the Cramér-Rao
// bound (median of the distribution: 0.944). NaN if J is singular.
double error_over_bound(const Pose& estimate, const Pose& truth, const Matrix6d& information);

struct MotionScore {
  SixDof truth, estimate, error;  // previous_from_current of the robot
  double translation_error_m = 0, rotation_error_rad = 0;
};

MotionScore score_motion(const Pose& estimate, const Pose& truth);

double median_of(std::vector<double> values);

// Median and its 95 % bootstrap interval (2000 resamples, fixed seed); NaN if `values` is empty.
struct MedianInterval {
  double median = std::numeric_limits<double>::quiet_NaN();
  double low = std::numeric_limits<double>::quiet_NaN(), high = std::numeric_limits<double>::quiet_NaN();
};
MedianInterval median_interval_of(const std::vector<double>& values);

// Quantile q in [0, 1] with linear interpolation between order statistics; NaN if `values` is empty.
double quantile_of(std::vector<double> values, double q);

}  // namespace fringeslam
