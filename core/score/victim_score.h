// SPDX-License-Identifier: Apache-2.0
// Victims that were found against those that could be: what of them is lit by the projector and seen by camera and
// thermal camera at once.
#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

struct VictimScoreOptions {
  double least_area_m2 = 0.002;  // visible in one view: a victim that shows less is not one to be found
  double reach_m = 0.02;         // within which two points are of one surface
  double least_marked = 0.2;     // share of a victim's visible surface that a candidate must mark to have found it
};

// What the views truly show of each victim, by its object's number.
class VisibleVictims {
 public:
  void add(const TruthFrame& truth, const Pinhole& camera, const Pose& world_from_camera);

  struct Victim {
    double area_m2 = 0;                     // of the view that shows most of it
    std::vector<Eigen::Vector3d> points_m;  // world, every few pixels of every view
  };
  const std::map<int, Victim>& all() const { return victims_; }

 private:
  std::map<int, Victim> victims_;
};

struct VictimScore {
  int to_find = 0, found = 0;  // victims
  int candidates = 0, right = 0;
  std::vector<int> missed;    // objects
  std::vector<size_t> wrong;  // candidates
  // NaN when there is nothing to find, or no candidate.
  double recall() const;
  double precision() const;
};

// A candidate is some points of what was taken for a victim, in the truth's world. It is right when most of them lie on
// victims, of whatever size. A victim is found when a right candidate marks enough of it; one may mark several.
using VictimCandidate = std::vector<Eigen::Vector3d>;
VictimScore score_victims(const VisibleVictims& victims, const std::vector<VictimCandidate>& candidates,
                          const VictimScoreOptions& options = {});

}  // namespace fringeslam
