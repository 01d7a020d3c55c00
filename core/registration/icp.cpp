// SPDX-License-Identifier: Apache-2.0
#include "core/registration/icp.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "core/registration/plane_pairs.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr int kWidestStride = 16;

double smallest_sigma(const Frame& frame) {
  float smallest = std::numeric_limits<float>::infinity();
  for (int row = 0; row < frame.height(); ++row) {
    const float* const sigma = frame.sigma_m[row];
    for (int col = 0; col < frame.width(); ++col)
      smallest = sigma[col] > 0 && sigma[col] < smallest ? sigma[col] : smallest;
  }
  return static_cast<double>(smallest);
}

// Subtracts the information induced by the normals' noise from the surfaces' sums. In the basis in which the sums'
// information H is the identity and the noise-induced one is diagonal (lambda), the true share is 1 - lambda, while
// the gradient has the covariance H: this is a measurement with information (1 - lambda)^2, and the gradient is scaled
// accordingly.
void remove_noise_induced_information(PlaneSums& sums, const Matrix6d& noise_induced) {
  // A remainder in a direction with little other information may be chance: windows of neighbouring normals share
  // pixels, so that even with many pairs the noise-induced share is only known to a few per cent.
  constexpr double kMargin = 1.2, kLeast = 1e-3;
  const std::optional<CommonBasis> common = common_basis(sums.information, noise_induced, sums.gradient);
  if (!common) return;
  const Matrix6d& basis = common->basis;
  const Vector6d left = (1 - kMargin * common->values.array()).max(kLeast);
  sums.information = basis * left.cwiseAbs2().asDiagonal() * basis.transpose();
  sums.gradient = basis * left.cwiseProduct(common->coordinates);
}

// In sigmas of the information of all points.
double reopened_sigma(PlanePairs& problem, double least_sigma_m, const Pose& target_from_source, int stride,
                      const Matrix6d& information) {
  constexpr double kOpen_m = 5e-3;
  const PlaneSums sums = problem.linearise(target_from_source, {kOpen_m, kOpen_m / least_sigma_m}, stride);
  const Vector6d step = solve_symmetric(sums.information, -sums.gradient);
  return stride * std::sqrt(step.dot(information * step));
}

IcpResult refined(PlanePairs& problem, double least_sigma_m, const Pose& initial, const IcpOptions& options,
                  const Matrix6d& prior) {
  IcpResult result;
  result.target_from_source = orthonormalised(initial);
  const int points = problem.points(options.stride);
  if (points < 6) return result;

  // The gates start wide and shrink by at most half per iteration, down to the noise (graduated non-convexity). They
  // must not follow the residuals immediately: most of those belong to flat ground, which reaches the noise level long
  // before the few walls that constrain sideways motion have been aligned. All points are needed only at the end.
  constexpr double kSettledSigmas = 0.25, kCycleSigmas = 1;
  PlaneGates gates{options.max_distance_m, std::max(options.max_distance_m / least_sigma_m, options.outlier_sigma)};
  const bool has_prior = !prior.isZero(0);
  // A quarter of the points suffices to estimate the noise-induced share: windows of neighbouring normals overlap.
  const auto noise_induced = [&](int stride, int pairs) -> Matrix6d {
    const PlaneSums some = problem.linearise(result.target_from_source, gates, std::min(2 * stride, kWidestStride),
                                             PairNormal::half_difference);
    return some.information * (static_cast<double>(pairs) / std::max(1, some.pairs));
  };
  const auto linearised = [&](int stride) {
    PlaneSums sums = problem.linearise(result.target_from_source, gates, stride);
    // Without a prior, those directions stay at their current values.
    if (has_prior) remove_noise_induced_information(sums, noise_induced(stride, sums.pairs));
    sums.information += prior;
    sums.gradient += prior * difference(result.target_from_source, initial);
    return sums;
  };
  PlaneSums sums;
  const int finest = options.stride;
  int stride = std::max(finest, 4);
  bool settled = false;
  double damping = 1;
  Vector6d last_step = Vector6d::Zero();
  for (result.iterations = 0; result.iterations < options.max_iterations && !settled; ++result.iterations) {
    if (gates.outlier_sigma < 16 * options.outlier_sigma) stride = std::max(finest, std::min(stride, 2));
    sums = linearised(stride);
    if (sums.pairs < 6) return result;
    const std::optional<Vector6d> solution = solve_well_conditioned(sums.information, -sums.gradient, 1e-12);
    if (!solution) return result;
    const Vector6d& step = *solution;
    // Correspondences keep flipping between neighbouring pixels, and the steps oscillate with them. Damped steps end
    // in between, where the difference is far below the noise.
    damping = step.dot(sums.information * last_step) < 0 ? 0.5 * damping : 1;
    result.target_from_source = retract(result.target_from_source, damping * step);
    last_step = step;
    const double rms = std::sqrt(sums.squares_m2 / sums.pairs);
    const double sigmas = std::sqrt(step.dot(sums.information * step));
    if (gates.outlier_sigma <= options.outlier_sigma && sigmas < kCycleSigmas && damping * sigmas < kSettledSigmas) {
      settled = stride == finest;
      stride = finest;
    }
    gates.outlier_sigma = std::max(options.outlier_sigma, 0.5 * gates.outlier_sigma);
    gates.distance_m = std::min(gates.distance_m, std::max(6 * rms, 0.5 * gates.distance_m));
  }
  if (stride > finest) sums = linearised(finest);
  result.pairs = sums.pairs;
  result.overlap = static_cast<double>(sums.pairs) / points;
  result.consistency = static_cast<double>(sums.pairs) / std::max(1, sums.seen);
  result.rms_m = std::sqrt(sums.squares_m2 / sums.pairs);
  result.rms_sigma = std::sqrt(sums.squares_sigma / sums.pairs);
  result.converged = settled && result.overlap >= options.min_overlap && result.rms_sigma <= options.max_rms_sigma;
  if (result.converged)
    result.reopened_sigma = reopened_sigma(problem, least_sigma_m, result.target_from_source, finest, sums.information);
  if (!has_prior) remove_noise_induced_information(sums, noise_induced(finest, sums.pairs));
  result.information = sums.information;
  return result;
}

// A pose and its score: the number of points with a correspondence, reduced where points contradict it. If one view
// looks through a surface seen by the other, the pose is wrong.
struct Candidate {
  Pose target_from_source;
  double score = -1, consistency = 0;
};

// Takes a few Gauss-Newton steps with narrowing gates.
Candidate followed(PlanePairs& problem, double least_sigma_m, Pose pose, double first_m, double last_m, int steps,
                   int stride) {
  const auto linearised = [&](double gate_m) {
    return problem.linearise(pose, {gate_m, gate_m / least_sigma_m}, stride);
  };
  for (int i = 0; i < steps; ++i) {
    const PlaneSums sums = linearised(first_m * std::pow(last_m / first_m, static_cast<double>(i) / (steps - 1)));
    if (sums.pairs < 20) return {pose};
    // Keeps directions in place in which the few points could slide.
    const double hold = 1e-4 * sums.information.diagonal().maxCoeff();
    pose = retract(pose, solve_symmetric(Matrix6d(sums.information + hold * Matrix6d::Identity()), -sums.gradient));
  }
  const PlaneSums sums = linearised(last_m);
  const double consistency = sums.pairs / std::max(1.0, static_cast<double>(sums.seen));
  return {pose, sums.pairs * consistency * consistency, consistency};
}

void check(const IcpOptions& options) {
  check_options(options, "icp");
  if (!std::has_single_bit(static_cast<unsigned>(options.stride)))
    throw Error("icp.stride is " + std::to_string(options.stride) + "; it must be 1, 2, 4, 8 or 16");
}

// Returns a translation along the optical axis to the median depth of the source.
Pose to_middle(const Frame& source) {
  std::vector<float> depths;
  for (int row = 0; row < source.height(); row += 8) {
    for (int col = 0; col < source.width(); col += 8) {
      if (source.valid(row, col)) depths.push_back(source.points_m(row, col)[2]);
    }
  }
  if (depths.empty()) return {};
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return {Eigen::Matrix3d::Identity(), {0, 0, *middle}};
}

// Returns rotations about the middle in all directions, each combined with shifts.
std::vector<Pose> starts(const Pose& middle) {
  constexpr double kTurn = 10 * std::numbers::pi / 180, kShift_m = 0.06;
  const Pose back = middle.inverse();
  std::vector<Pose> poses;
  for (int i = 0; i < 3 * 3 * 3 * 5 * 5; ++i) {
    const auto digit = [&](int below, int base) { return i / below % base - base / 2; };
    const Eigen::Vector3d turn(digit(1, 3), digit(3, 3), digit(9, 3));
    const Eigen::Vector3d shift(digit(27, 5), digit(135, 5), 0);
    poses.push_back(middle * Pose{rotation_exp(kTurn * turn), kShift_m * shift} * back);
  }
  return poses;
}

// Returns a small random motion about the middle.
Pose nudge(const Pose& middle, std::mt19937& random) {
  constexpr double kTurn = 0.04, kShift_m = 0.012;
  const auto within = [&](double most) { return most * (2 * (static_cast<double>(random()) / 4294967295.0) - 1); };
  Pose motion;
  const double x = within(kTurn), y = within(kTurn), z = within(kTurn);
  motion.rotation = rotation_exp({x, y, z});
  for (int i = 0; i < 3; ++i) motion.translation[i] = within(kShift_m);
  return middle * motion * middle.inverse();
}

}  // namespace

IcpResult point_to_plane_icp(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                             const IcpOptions& options, const Matrix6d& prior) {
  check(options);
  PlanePairs problem(target, source, camera, options.max_normal_deg);
  return refined(problem, smallest_sigma(source), initial, options, prior);
}

IcpResult register_frames(const Frame& target, const Frame& source, const Pinhole& camera, const IcpOptions& options) {
  check(options);
  constexpr double kWide_m = 0.05, kNarrow_m = 0.015, kClose_m = 2e-3, kConsistent = 0.96;
  constexpr size_t kFollowed = 12, kNudged = 2;
  constexpr int kFirstNudges = 24, kNudges = 200;
  const double least_sigma = smallest_sigma(source);
  PlanePairs problem(target, source, camera, options.max_normal_deg);
  const auto better = [](const Candidate& a, const Candidate& b) { return a.score > b.score; };
  const auto closer = [&](const Pose& pose) { return followed(problem, least_sigma, pose, kNarrow_m, kClose_m, 8, 8); };
  const Pose middle = to_middle(source);
  std::mt19937 random(1);
  // Random motions escape from poses that converged next to the correct one, as happens on ground with few objects.
  const auto nudged_out = [&](Candidate& candidate) {
    const Candidate nudged = closer(candidate.target_from_source * nudge(middle, random));
    if (better(nudged, candidate)) candidate = nudged;
  };
  // Small motions are found from the identity.
  Candidate best = closer(followed(problem, least_sigma, {}, kWide_m, kNarrow_m, 10, 8).target_from_source);
  for (int i = 0; i < kFirstNudges && best.consistency < kConsistent; ++i) nudged_out(best);
  if (best.consistency < kConsistent) {
    std::vector<Candidate> candidates = {best};
    for (const Pose& start : starts(middle))
      candidates.push_back(followed(problem, least_sigma, start, kWide_m, kNarrow_m, 8, 16));
    std::stable_sort(candidates.begin(), candidates.end(), better);
    candidates.resize(std::min(candidates.size(), kFollowed));
    for (Candidate& candidate : candidates) candidate = closer(candidate.target_from_source);
    std::stable_sort(candidates.begin(), candidates.end(), better);
    candidates.resize(std::min(candidates.size(), kNudged));
    for (int i = 0; i < kNudges && candidates[0].consistency < kConsistent; ++i) {
      nudged_out(candidates[static_cast<size_t>(i) % candidates.size()]);
      std::stable_sort(candidates.begin(), candidates.end(), better);
    }
    best = candidates[0];
  }
  IcpOptions fine = options;
  fine.max_distance_m = std::min(options.max_distance_m, 0.01);
  fine.max_iterations = 2 * options.max_iterations;
  return refined(problem, least_sigma, best.target_from_source, fine, Matrix6d::Zero());
}

}  // namespace fringeslam
