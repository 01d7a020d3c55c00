// SPDX-License-Identifier: Apache-2.0
// Scores victim candidates against the visible victims. A victim's surface counts as visible where the projector lights
// it and both the camera and the thermal camera see it.
#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

struct VictimScoreOptions {
  double least_area_m2 = 0.002;  // visible in one view; victims with less need not be found
  double reach_m = 0.02;         // two points closer than this belong to the same surface
  double least_marked = 0.2;     // share of a victim's visible surface to be marked for it to count as found
};

// Accumulates the visible surface of each victim, keyed by object id.
class VisibleVictims {
 public:
  void add(const TruthFrame& truth, const Pinhole& camera, const Pose& world_from_camera);

  struct Victim {
    double area_m2 = 0;                     // visible area in the view that shows most of it
    std::vector<Eigen::Vector3d> points_m;  // world frame, every third pixel and row of every view
  };
  const std::map<int, Victim>& all() const { return victims_; }

 private:
  std::map<int, Victim> victims_;
};

struct VictimScore {
  int to_find = 0, found = 0;  // victims
  int candidates = 0, right = 0;
  std::vector<int> missed;    // object ids
  std::vector<size_t> wrong;  // candidate indices
  // NaN if there is no victim to find (recall) or no candidate (precision).
  double recall() const;
  double precision() const;
};

// A candidate is a set of points taken for a victim, in the ground truth's world frame, m. It is right if more than
// half of them lie on victims of any size. A victim is found if right candidates together mark enough of its visible
// surface; one candidate may mark several victims.
using VictimCandidate = std::vector<Eigen::Vector3d>;
VictimScore score_victims(const VisibleVictims& victims, const std::vector<VictimCandidate>& candidates,
                          const VictimScoreOptions& options = {});

}  // namespace fringeslam
