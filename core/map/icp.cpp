// SPDX-License-Identifier: Apache-2.0
#include "core/map/icp.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "core/map/plane_pairs.h"

namespace fringeslam {

namespace {

double smallest_sigma(const Frame& frame) {
  double smallest = std::numeric_limits<double>::infinity();
  for (const float sigma : frame.sigma_m) {
    if (sigma > 0) smallest = std::min(smallest, static_cast<double>(sigma));
  }
  return smallest;
}

}  // namespace

namespace {

IcpResult refined(const PlanePairs& problem, double least_sigma_m, const Pose& initial, const IcpOptions& options,
                  const Matrix6d& prior) {
  IcpResult result;
  result.target_from_source = initial;
  const int points = problem.points(1);
  if (points < 6) return result;

  // The gates start wide and halve with each iteration down to the noise (graduated non-convexity). They
  // must not follow the residuals down at once: those are mostly of flat ground, at the noise long before the
  // few walls that hold the view sideways have been pulled in. All points are needed at the end only.
  constexpr double kSettledSigmas = 0.25;
  PlaneGates gates{options.max_distance_m, std::max(options.max_distance_m / least_sigma_m, options.outlier_sigma)};
  PlaneSums sums;
  int stride = 4;
  bool settled = false;
  for (result.iterations = 0; result.iterations < options.max_iterations && !settled; ++result.iterations) {
    if (gates.outlier_sigma < 16 * options.outlier_sigma) stride = std::min(stride, 2);
    sums = problem.linearise(result.target_from_source, gates, stride);
    if (sums.pairs < 6) return result;
    sums.information += prior;
    sums.gradient += prior * difference(result.target_from_source, initial);
    const Eigen::LDLT<Matrix6d> factor(sums.information);
    if (factor.info() != Eigen::Success || !(factor.rcond() > 1e-12)) return result;
    const Vector6d step = factor.solve(-sums.gradient);
    result.target_from_source = retract(result.target_from_source, step);
    const double rms = std::sqrt(sums.squares_m2 / sums.pairs);
    // Partners flip between neighbouring pixels for ever; a step far below what noise can do ends it.
    if (gates.outlier_sigma <= options.outlier_sigma &&
        step.dot(sums.information * step) < kSettledSigmas * kSettledSigmas) {
      settled = stride == 1;
      stride = 1;
    }
    gates.outlier_sigma = std::max(options.outlier_sigma, 0.5 * gates.outlier_sigma);
    gates.distance_m = std::min(gates.distance_m, std::max(6 * rms, 0.5 * gates.distance_m));
  }
  if (stride > 1) sums = problem.linearise(result.target_from_source, gates, 1);
  result.pairs = sums.pairs;
  result.overlap = static_cast<double>(sums.pairs) / points;
  result.rms_m = std::sqrt(sums.squares_m2 / sums.pairs);
  result.rms_sigma = std::sqrt(sums.squares_sigma / sums.pairs);
  result.information = sums.information;
  result.converged = settled && result.overlap >= options.min_overlap && result.rms_sigma <= options.max_rms_sigma;
  return result;
}

// A few steps with wide gates that narrow to `last_m`, and how many points have a partner then.
struct Candidate {
  Pose target_from_source;
  int pairs = 0;
};
Candidate followed(const PlanePairs& problem, double least_sigma_m, Pose pose, double first_m, double last_m, int steps,
                   int stride) {
  for (int i = 0; i < steps; ++i) {
    const double gate = first_m * std::pow(last_m / first_m, static_cast<double>(i) / (steps - 1));
    const PlaneSums sums = problem.linearise(pose, {gate, gate / least_sigma_m}, stride);
    if (sums.pairs < 20) return {pose, 0};
    // Directions in which the few points could slide stay where they are.
    const double hold = 1e-4 * sums.information.diagonal().maxCoeff();
    pose = retract(pose, (sums.information + hold * Matrix6d::Identity()).ldlt().solve(-sums.gradient));
  }
  return {pose, problem.linearise(pose, {last_m, last_m / least_sigma_m}, stride).pairs};
}

// Turns about a point amid the source's surfaces, to all sides.
std::vector<Pose> starts(const Frame& source) {
  std::vector<float> depths;
  for (int row = 0; row < source.height(); row += 8) {
    for (int col = 0; col < source.width(); col += 8) {
      if (source.valid(row, col)) depths.push_back(source.points_m(row, col)[2]);
    }
  }
  if (depths.empty()) return {};
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  const Pose to_middle{Eigen::Matrix3d::Identity(), {0, 0, depths[depths.size() / 2]}};
  std::vector<Pose> poses;
  constexpr double kTurn = 10 * std::numbers::pi / 180, kShift_m = 0.06;
  for (const double x : {0.0, -kTurn, kTurn}) {
    for (const double y : {0.0, -kTurn, kTurn}) {
      for (const double z : {0.0, -kTurn, kTurn}) {
        for (const double a : {0.0, -kShift_m, kShift_m}) {
          for (const double b : {0.0, -kShift_m, kShift_m}) {
            const Pose turn{rotation_exp({x, y, z}), {a, b, 0}};
            poses.push_back(to_middle * turn * to_middle.inverse());
          }
        }
      }
    }
  }
  return poses;
}

}  // namespace

IcpResult point_to_plane_icp(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                             const IcpOptions& options, const Matrix6d& prior) {
  check_options(options, "icp");
  return refined(PlanePairs(target, source, camera, options.max_normal_deg), smallest_sigma(source), initial, options,
                 prior);
}

IcpResult register_frames(const Frame& target, const Frame& source, const Pinhole& camera, const IcpOptions& options) {
  check_options(options, "icp");
  constexpr double kWide = 0.06, kNarrow = 0.01, kClose = 2e-3;
  constexpr size_t kFollowed = 8;
  const double least_sigma = smallest_sigma(source);
  const PlanePairs problem(target, source, camera, options.max_normal_deg);
  std::vector<Candidate> candidates;
  for (const Pose& start : starts(source))
    candidates.push_back(followed(problem, least_sigma, start, kWide, kNarrow, 8, 16));
  if (candidates.empty()) return {};
  const auto by_pairs = [](const Candidate& a, const Candidate& b) { return a.pairs > b.pairs; };
  std::stable_sort(candidates.begin(), candidates.end(), by_pairs);
  candidates.resize(std::min(candidates.size(), kFollowed));
  for (Candidate& candidate : candidates)
    candidate = followed(problem, least_sigma, candidate.target_from_source, kNarrow, kClose, 8, 8);
  const Pose best = std::min_element(candidates.begin(), candidates.end(), by_pairs)->target_from_source;
  IcpOptions fine = options;
  fine.max_distance_m = std::min(options.max_distance_m, kClose);
  return refined(problem, least_sigma, best, fine, Matrix6d::Zero());
}

}  // namespace fringeslam
