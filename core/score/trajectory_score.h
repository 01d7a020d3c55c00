// SPDX-License-Identifier: Apache-2.0
// Scores trajectories against ground truth with evo's definitions (M. Grupp, evo: Python package for the evaluation of
// odometry and SLAM, 2017). For ground-truth poses Q and associated estimated poses P, after alignment of P:
//
//   APE_i  translation  |t(P_i) - t(Q_i)|        rotation  angle of P_i^-1 Q_i        full  ||P_i^-1 Q_i - I||_F
//   RPE_i  translation and rotation of (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), j = i + delta
//
// The alignment S minimises sum |t(Q_i) - S t(P_i)|^2, with or without scale (S. Umeyama, Least-squares estimation of
// transformation parameters between two point patterns, PAMI 13, 1991, eq. 40-42).
#pragma once

#include <array>
#include <limits>
#include <utility>
#include <vector>

#include "core/types/options.h"
#include "core/types/trajectory.h"

namespace fringeslam {

// Alignment before APE: none, of the first poses (origin), of all positions without (se3) or with scale (sim3).
enum class Alignment { none, origin, se3, sim3 };

constexpr auto choices(Alignment) {
  using enum Alignment;
  return std::to_array<Choice<Alignment>>({{none, "none"}, {origin, "origin"}, {se3, "se3"}, {sim3, "sim3"}});
}

// Part of the pose error that APE measures.
enum class PoseRelation { translation, rotation_deg, full };

constexpr auto choices(PoseRelation) {
  using enum PoseRelation;
  return std::to_array<Choice<PoseRelation>>(
      {{translation, "translation"}, {rotation_deg, "rotation_deg"}, {full, "full"}});
}

struct TrajectoryOptions {
  Alignment align = Alignment::origin;
  PoseRelation relation = PoseRelation::translation;
  int delta = 1;
  bool all_pairs = false;
  double max_gap_s = 0.01;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("align", align,
            "before APE: none, of the first poses (origin), of all positions without (se3) or with scale (sim3)");
    v.field("relation", relation, "part of the pose error that APE measures");
    v.field("delta", delta, {1, 1e9}, "distance between the two poses of an RPE, frames");
    v.field("all_pairs", all_pairs, "compute RPE from every frame, not only from every delta-th");
    v.field("max_gap_s", max_gap_s, {0, 1e9}, "largest timestamp difference of associated poses, s");
  }
};

struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0;
  double sse = 0;  // sum of squares
};

// Summary statistics of `errors`; NaN if empty. `std` is the population standard deviation.
ErrorStatistics statistics_of(const std::vector<double>& errors);

// x -> scale (rotation x) + translation.
struct Similarity {
  double scale = 1;
  Pose pose;

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (pose.rotation * point) + pose.translation;
  }
  // Scales the position; the rotation is not scaled.
  Pose operator*(const Pose& p) const { return {pose.rotation * p.rotation, *this * p.translation}; }
};

// The similarity S (rigid unless with_scale) that minimises sum |to_i - S from_i|^2. Sets `unique`, if given, to true
// if the points determine the rotation, i.e. if neither set is collinear. Throws Error if a scale is requested but the
// points of one set coincide.
Similarity align_similarity(const std::vector<Eigen::Vector3d>& to, const std::vector<Eigen::Vector3d>& from,
                            bool with_scale, bool* unique = nullptr);

struct TrajectoryScore {
  int poses = 0;  // number of associated poses

  // Independent of the options.
  double ate_rmse_m = 0;          // translation, first poses aligned (evo_ape --align_origin)
  double ate_umeyama_rmse_m = 0;  // translation, best SE(3) alignment (evo_ape --align)
  double rpe_translation_rmse_m = 0, rpe_rotation_rmse_rad = 0;  // consecutive poses (evo_rpe, delta 1 frame)

  // Depending on the options.
  TrajectoryOptions options;
  Similarity truth_from_estimate;
  ErrorStatistics ape;  // m, degrees, or dimensionless (full)
  int steps = 0;        // number of pose pairs in the RPE
  ErrorStatistics rpe_translation_m, rpe_rotation_deg;
};

// Computes all scores. Throws Error if fewer than two poses can be associated, if no two poses are delta apart, if a
// rotation is needed but the positions are collinear, or if a scale is requested but one trajectory does not move.
TrajectoryScore score_trajectory(const Trajectory& estimate, const Trajectory& truth,
                                 const TrajectoryOptions& options = {});

// The alignment alone, including its rotation; one associated pose is enough for Alignment::origin. Throws Error
// under the same conditions as score_trajectory().
Similarity align_trajectory(const Trajectory& estimate, const Trajectory& truth, const TrajectoryOptions& options);

// Pairs (estimate index, truth index); no index occurs twice. Each pose of the shorter trajectory is paired with the
// pose of the other one nearest in time (the earlier of two equally near ones), at most max_gap_s apart. If two poses
// compete for the same one, the nearer gets it; evo would use it twice.
std::vector<std::pair<size_t, size_t>> associate(const Trajectory& estimate, const Trajectory& truth,
                                                 double max_gap_s = 0.01);

}  // namespace fringeslam
