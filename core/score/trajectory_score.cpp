// SPDX-License-Identifier: Apache-2.0
#include "core/score/trajectory_score.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/score/score.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

using Points = std::vector<Eigen::Vector3d>;

Eigen::Vector3d mean_of(const Points& points) {
  const Eigen::Vector3d sum = std::accumulate(points.begin(), points.end(), Eigen::Vector3d(0, 0, 0));
  return sum / static_cast<double>(points.size());
}

// Poses at the same instants, in temporal order.
struct Associated {
  std::vector<Pose> truth, estimate;
};

Associated associated(const Trajectory& estimate, const Trajectory& truth, double max_gap_s, size_t least) {
  Associated poses;
  for (const auto& [i, j] : associate(estimate, truth, max_gap_s)) {
    poses.estimate.push_back(estimate[i].world_from_robot);
    poses.truth.push_back(truth[j].world_from_robot);
  }
  if (poses.truth.size() < least)
    throw Error("only " + std::to_string(poses.truth.size()) +
                " poses of the estimate have a ground-truth pose within " + to_text(max_gap_s * 1e3) + " ms; " +
                (least == 1 ? "at least one is required" : "at least two are required") +
                "; check that both have the same clock");
  return poses;
}

Points positions(const std::vector<Pose>& poses) {
  Points points;
  points.reserve(poses.size());
  for (const Pose& pose : poses) points.push_back(pose.translation);
  return points;
}

Similarity alignment(const Associated& poses, Alignment how, bool needs_rotation) {
  if (how == Alignment::none) return {};
  if (how == Alignment::origin) return {1, poses.truth.front() * poses.estimate.front().inverse()};
  bool unique = false;
  const Similarity result =
      align_similarity(positions(poses.truth), positions(poses.estimate), how == Alignment::sim3, &unique);
  if (needs_rotation && !unique)
    throw Error(
        "score: collinear positions do not determine the rotation about their line; use align 'origin' instead");
  return result;
}

double ate_rmse(const Associated& poses, const Similarity& truth_from_estimate) {
  double squares = 0;
  for (size_t i = 0; i < poses.truth.size(); ++i)
    squares += (truth_from_estimate * poses.estimate[i].translation - poses.truth[i].translation).squaredNorm();
  return std::sqrt(squares / static_cast<double>(poses.truth.size()));
}

double frobenius_from_identity(const Pose& error) {
  return std::sqrt((error.rotation - Eigen::Matrix3d::Identity()).squaredNorm() + error.translation.squaredNorm());
}

std::vector<double> absolute_errors(const Associated& poses, const Similarity& truth_from_estimate,
                                    PoseRelation relation) {
  std::vector<double> errors;
  for (size_t i = 0; i < poses.truth.size(); ++i) {
    const Pose aligned = truth_from_estimate * poses.estimate[i];
    const Pose error = aligned.inverse() * poses.truth[i];
    errors.push_back(relation == PoseRelation::translation    ? translation_m(error)
                     : relation == PoseRelation::rotation_deg ? rotation_rad(error) * kDegPerRad
                                                              : frobenius_from_identity(error));
  }
  return errors;
}

struct RelativeErrors {
  std::vector<double> translation_m, rotation_deg;
};

RelativeErrors relative_errors(const Associated& poses, double scale, int delta, bool all_pairs) {
  RelativeErrors errors;
  const auto apart = static_cast<size_t>(delta);
  for (size_t i = 0; i + apart < poses.truth.size(); i += all_pairs ? 1 : apart) {
    const Pose truth = poses.truth[i].inverse() * poses.truth[i + apart];
    Pose estimate = poses.estimate[i].inverse() * poses.estimate[i + apart];
    estimate.translation *= scale;
    const Pose error = truth.inverse() * estimate;
    errors.translation_m.push_back(translation_m(error));
    errors.rotation_deg.push_back(rotation_rad(error) * kDegPerRad);
  }
  if (errors.rotation_deg.empty())
    throw Error("score: no two of " + std::to_string(poses.truth.size()) + " associated poses are " +
                std::to_string(delta) + " frames apart; use a smaller delta");
  return errors;
}

}  // namespace

ErrorStatistics statistics_of(const std::vector<double>& errors) {
  ErrorStatistics s;
  const auto n = static_cast<double>(errors.size());
  for (const double e : errors) s.sse += e * e;
  s.rmse = std::sqrt(s.sse / n);
  s.mean = std::accumulate(errors.begin(), errors.end(), 0.0) / n;
  double spread = 0;
  for (const double e : errors) spread += (e - s.mean) * (e - s.mean);
  s.std = std::sqrt(spread / n);
  s.median = median_of(errors);
  s.min = quantile_of(errors, 0);
  s.max = quantile_of(errors, 1);
  return s;
}

Similarity align_similarity(const Points& to, const Points& from, bool with_scale, bool* unique) {
  // Extents below this are rounding errors.
  constexpr double kLeastExtent_m = 1e-9;
  // Ratio of the correlation's singular values below which both sets are collinear to a millionth of their length.
  constexpr double kCollinearRatio = 1e-12;
  Similarity result{1, align_points(to, from)};
  const Eigen::Vector3d to_mean = mean_of(to), from_mean = mean_of(from);
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  double to2 = 0, from2 = 0, along = 0;
  for (size_t i = 0; i < to.size(); ++i) {
    const Eigen::Vector3d t = to[i] - to_mean, f = from[i] - from_mean;
    correlation += t * f.transpose();
    to2 += t.squaredNorm(), from2 += f.squaredNorm();
    along += t.dot(result.pose.rotation * f);
  }
  if (unique) {
    const Eigen::Vector3d singular = singular_values(correlation);
    *unique = singular[1] > kCollinearRatio * singular[0];
  }
  if (!with_scale) return result;
  const double least2 = static_cast<double>(to.size()) * kLeastExtent_m * kLeastExtent_m;
  if (!(to2 > least2) || !(from2 > least2))
    throw Error("score: a trajectory without motion does not determine a scale; use align 'se3' or 'origin' instead");
  // tr(D S) in Umeyama's eq. 42 equals tr(R^T correlation), the correlation of the rotated points.
  result.scale = along / from2;
  result.pose.translation = to_mean - result.scale * (result.pose.rotation * from_mean);
  return result;
}

std::vector<std::pair<size_t, size_t>> associate(const Trajectory& estimate, const Trajectory& truth,
                                                 double max_gap_s) {
  const bool estimate_is_shorter = estimate.size() <= truth.size();
  const Trajectory &few = estimate_is_shorter ? estimate : truth, &many = estimate_is_shorter ? truth : estimate;
  const auto gap_s = [&](size_t i, size_t j) { return std::abs(many[j].timestamp_s - few[i].timestamp_s); };
  std::vector<std::pair<size_t, size_t>> pairs;
  size_t j = 0;
  for (size_t i = 0; i < few.size(); ++i) {
    while (j + 1 < many.size() && gap_s(i, j + 1) < gap_s(i, j)) ++j;
    if (j >= many.size() || !(gap_s(i, j) <= max_gap_s)) continue;
    const bool taken = !pairs.empty() && pairs.back().second == j;
    if (!taken)
      pairs.emplace_back(i, j);
    else if (gap_s(i, j) < gap_s(pairs.back().first, j))
      pairs.back().first = i;
  }
  if (!estimate_is_shorter) {
    for (auto& [first, second] : pairs) std::swap(first, second);
  }
  return pairs;
}

Similarity align_trajectory(const Trajectory& estimate, const Trajectory& truth, const TrajectoryOptions& options) {
  check_options(options, "score");
  return alignment(associated(estimate, truth, options.max_gap_s, 1), options.align, true);
}

TrajectoryScore score_trajectory(const Trajectory& estimate, const Trajectory& truth,
                                 const TrajectoryOptions& options) {
  check_options(options, "score");
  const Associated poses = associated(estimate, truth, options.max_gap_s, 2);
  TrajectoryScore score;
  score.poses = static_cast<int>(poses.truth.size());
  score.ate_rmse_m = ate_rmse(poses, alignment(poses, Alignment::origin, false));
  score.ate_umeyama_rmse_m = ate_rmse(poses, alignment(poses, Alignment::se3, false));
  const RelativeErrors consecutive = relative_errors(poses, 1, 1, false);
  score.rpe_translation_rmse_m = statistics_of(consecutive.translation_m).rmse;
  score.rpe_rotation_rmse_rad = statistics_of(consecutive.rotation_deg).rmse / kDegPerRad;

  score.options = options;
  score.truth_from_estimate = alignment(poses, options.align, options.relation != PoseRelation::translation);
  score.ape = statistics_of(absolute_errors(poses, score.truth_from_estimate, options.relation));
  const RelativeErrors steps =
      relative_errors(poses, score.truth_from_estimate.scale, options.delta, options.all_pairs);
  score.steps = static_cast<int>(steps.rotation_deg.size());
  score.rpe_translation_m = statistics_of(steps.translation_m);
  score.rpe_rotation_deg = statistics_of(steps.rotation_deg);
  return score;
}

}  // namespace fringeslam
