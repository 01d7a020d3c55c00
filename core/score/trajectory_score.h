// SPDX-License-Identifier: Apache-2.0
// Trajectories against the true one, as evo computes it (M. Grupp, evo: Python package for the evaluation of odometry
// and SLAM, 2017). With Q true and P estimated poses of the same times, P after the alignment:
//
//   APE_i  translation  |t(P_i) - t(Q_i)|        rotation  angle of P_i^-1 Q_i        full  ||P_i^-1 Q_i - I||_F
//   RPE_i  the same of (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), j = i + delta
//
// The alignment S with the least sum |t(Q_i) - S t(P_i)|^2 is Umeyama's (S. Umeyama, Least-squares estimation of
// transformation parameters between two point patterns, PAMI 13, 1991, eq. 40-42), with and without scale.
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/types/options.h"
#include "core/types/trajectory.h"

namespace fringeslam {

struct TrajectoryOptions {
  std::string align = "origin";
  std::string relation = "translation";
  int delta = 1;
  bool all_pairs = false;
  double max_gap_s = 0.01;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("align", align, {"none", "origin", "se3", "sim3"},
            "first: of the first poses (origin), or of all positions, without or with scale");
    v.field("relation", relation, {"translation", "rotation_deg", "full"}, "what of the pose the APE is of");
    v.field("delta", delta, {1, 1e9}, "frames between the poses of an RPE");
    v.field("all_pairs", all_pairs, "RPE from every frame, not only from every delta-th");
    v.field("max_gap_s", max_gap_s, {0, 1e9}, "largest difference of the timestamps of one pose, s");
  }
};

struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0;
  double sse = 0;  // sum of squares
};

// NaN when empty. `std` is that of the population.
ErrorStatistics statistics_of(const std::vector<double>& errors);

// x -> scale (rotation x) + translation.
struct Similarity {
  double scale = 1;
  Pose pose;

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (pose.rotation * point) + pose.translation;
  }
  // Positions are scaled, rotations are not.
  Pose operator*(const Pose& p) const { return {pose.rotation * p.rotation, *this * p.translation}; }
};

// The similarity (rigid unless with_scale) that minimises sum |to_i - S from_i|^2. Throws Error when a scale is asked
// for but one of the sets does not extend. `unique`, if given: whether the points determine the rotation, that is,
// neither set lies on a line.
Similarity align_similarity(const std::vector<Eigen::Vector3d>& to, const std::vector<Eigen::Vector3d>& from,
                            bool with_scale, bool* unique = nullptr);

struct TrajectoryScore {
  int poses = 0;  // associated

  // Whatever the options.
  double ate_rmse_m = 0;          // translation, first poses aligned (evo_ape --align_origin)
  double ate_umeyama_rmse_m = 0;  // translation, best SE(3) alignment (evo_ape --align)
  double rpe_translation_rmse_m = 0, rpe_rotation_rmse_rad = 0;  // consecutive poses (evo_rpe, delta 1 frame)

  // By the options.
  TrajectoryOptions options;
  Similarity truth_from_estimate;
  ErrorStatistics ape;  // m, degrees, or without unit (full)
  int steps = 0;        // pairs of poses of the RPE
  ErrorStatistics rpe_translation_m, rpe_rotation_deg;
};

// Throws Error when fewer than two poses can be associated, when no two poses are delta apart, when a rotation is asked
// for but positions on a line leave it free, and when a scale is asked for but nothing moved.
TrajectoryScore score_trajectory(const Trajectory& estimate, const Trajectory& truth,
                                 const TrajectoryOptions& options = {});

// The alignment alone, rotation included; one pose is enough for it to be by the origin. Throws as score_trajectory()
// does.
Similarity align_trajectory(const Trajectory& estimate, const Trajectory& truth, const TrajectoryOptions& options);

// Pairs (estimate index, truth index), each index once: every pose of the shorter trajectory with the one of the other
// that is nearest in time, the earlier of two equally near, at most max_gap_s apart. Where two would take the same one,
// the nearer gets it; evo would use it twice.
std::vector<std::pair<size_t, size_t>> associate(const Trajectory& estimate, const Trajectory& truth,
                                                 double max_gap_s = 0.01);

}  // namespace fringeslam
