// SPDX-License-Identifier: Apache-2.0
// Errors against exact truth. All functions are of values; files are read by truth_files.h.
#pragma once

#include <limits>
#include <vector>

#include "core/score/trajectory_score.h"
#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

// What of an estimated view is scored, H x W, NaN where invalid.
struct DepthEstimate {
  cv::Mat1f depth_m, sigma_m, projector_column;
};

// The errors are NaN when nothing could be compared.
struct DepthScore {
  int compared = 0;                                            // pixels with both an estimate and a true depth
  double median_m = std::numeric_limits<double>::quiet_NaN();  // of |error|
  double rms_m = std::numeric_limits<double>::quiet_NaN();
  double p99_m = std::numeric_limits<double>::quiet_NaN();  // 99th percentile of |error|
  double valid_fraction = 0;                                // of the pixels that the projector lights
  double wrong_order =
      std::numeric_limits<double>::quiet_NaN();  // share of compared pixels more than half a fringe period off
  int spurious = 0;                              // estimates where the truth has no surface or no direct light
};

DepthScore score_depth(const DepthEstimate& estimate, const TruthFrame& truth, double finest_period_px);

// Fisher information of `previous_from_current` in the tangent of retract(), of the two frames' depth
// over their overlap (METHOD §5): J = sum g g^T / (sigma_A^2 + sigma_B^2), g = (R p x n, n), each sigma
// that of the residual along the normal, |n.d| sigma_z, and sigma_A^2 times the number of points of B that fall on the
// same pixel of A: their mean knows no more of it. Pixels that hold an edge (kTruthMixed) are left out:
// their error is not of zero mean with that sigma. Geometry from the truth, sigmas as estimated.
Matrix6d pose_information(const TruthFrame& previous, const cv::Mat1f& previous_sigma_m, const TruthFrame& current,
                          const cv::Mat1f& current_sigma_m, const Pinhole& camera, const PixelRays& rays,
                          const Pose& true_previous_from_current);

// sqrt(e^T J e / 6), e the tangent from truth to estimate: about 1 for an estimator at the Cramer-Rao
// bound (median of the distribution: 0.944). NaN when J is singular.
double error_over_bound(const Pose& estimate, const Pose& truth, const Matrix6d& information);

struct MotionScore {
  SixDof truth, estimate, error;  // previous_from_current of the robot
  double translation_error_m = 0, rotation_error_rad = 0;
};

MotionScore score_motion(const Pose& estimate, const Pose& truth);

double median_of(std::vector<double> values);
// Linear interpolation between order statistics; q in [0, 1]. NaN when empty.
double quantile_of(std::vector<double> values, double q);

}  // namespace fringeslam
