// SPDX-License-Identifier: Apache-2.0
#include "core/score/victim_score.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/types/frame.h"

namespace fringeslam {

namespace {

bool is_visible(int mask) {
  constexpr int kWanted = kTruthSurface | kTruthInBeam | kTruthVictim | kTruthThermal;
  return (mask & kWanted) == kWanted && !(mask & kTruthInShadow);
}

double share(int part, int whole) {
  return whole > 0 ? static_cast<double>(part) / whole : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

void VisibleVictims::add(const TruthFrame& truth, const Pinhole& camera, const Pose& world_from_camera) {
  constexpr double kLeastCosine = 0.26;  // surfaces seen at more than 75 degrees to the normal do not count
  constexpr int kEvery = 3;
  std::map<int, double> areas_m2;
  for (int row = 0; row < truth.mask.rows; ++row) {
    for (int col = 0; col < truth.mask.cols; ++col) {
      if (!is_visible(static_cast<int>(truth.mask(row, col)))) continue;
      const Eigen::Vector3d ray = camera.undistort({col, row}).homogeneous();
      const double towards = -ray.dot(vector_of(truth.normals(row, col)));
      if (!(towards > kLeastCosine * ray.norm())) continue;
      const auto z = static_cast<double>(truth.depth_m(row, col));
      const auto object = static_cast<int>(truth.object_id(row, col));
      areas_m2[object] += z * z / (camera.fx * camera.fy * towards);
      if (row % kEvery == 0 && col % kEvery == 0) victims_[object].points_m.push_back(world_from_camera * (z * ray));
    }
  }
  for (const auto& [object, area_m2] : areas_m2) {
    double& most = victims_[object].area_m2;
    most = std::max(most, area_m2);
  }
}

double VictimScore::recall() const { return share(found, to_find); }
double VictimScore::precision() const { return share(right, candidates); }

VictimScore score_victims(const VisibleVictims& victims, const std::vector<VictimCandidate>& candidates,
                          const VictimScoreOptions& options) {
  const auto on = [&](const Eigen::Vector3d& p, const std::vector<Eigen::Vector3d>& surface) {
    return std::any_of(surface.begin(), surface.end(),
                       [&](const Eigen::Vector3d& q) { return (p - q).norm() < options.reach_m; });
  };
  const auto share_on = [](const std::vector<Eigen::Vector3d>& points, const auto& holds) {
    return points.empty() ? 0.0
                          : static_cast<double>(std::count_if(points.begin(), points.end(), holds)) /
                                static_cast<double>(points.size());
  };
  VictimScore score;
  score.candidates = static_cast<int>(candidates.size());
  std::vector<const VictimCandidate*> right;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const double share = share_on(candidates[i], [&](const Eigen::Vector3d& p) {
      return std::any_of(victims.all().begin(), victims.all().end(),
                         [&](const auto& entry) { return on(p, entry.second.points_m); });
    });
    if (share > 0.5)
      right.push_back(&candidates[i]);
    else
      score.wrong.push_back(i);
  }
  score.right = static_cast<int>(right.size());
  for (const auto& [object, victim] : victims.all()) {
    if (victim.area_m2 < options.least_area_m2) continue;
    ++score.to_find;
    const double marked = share_on(victim.points_m, [&](const Eigen::Vector3d& p) {
      return std::any_of(right.begin(), right.end(), [&](const VictimCandidate* c) { return on(p, *c); });
    });
    if (marked >= options.least_marked)
      ++score.found;
    else
      score.missed.push_back(object);
  }
  return score;
}

}  // namespace fringeslam
