// SPDX-License-Identifier: Apache-2.0
// Merges the maps of two missions or robots (docs/method.md, section 8.4).
#pragma once

#include <functional>
#include <vector>

#include "core/mapper/mapper.h"

namespace fringeslam {

// A measured motion between a keyframe of one map and a keyframe of the other.
struct CrossLink {
  int a = 0, b = 0;  // numbers in their maps
  Pose a_from_b;     // of the cameras
  Matrix6d covariance = Matrix6d::Zero();
  bool by_landmarks = false;  // otherwise by depth, from the placement that others determined
  bool accepted = false;      // by the pose graph of both maps
};

struct MergedMap {
  KeyframeMap map;                         // in the world of A: the keyframes of A, then those of B
  Pose a_from_b;                           // world of A from that of B, at the first keyframe of B
  Matrix6d covariance = Matrix6d::Zero();  // of its tangent; see retract()
  std::vector<CrossLink> links;            // those by landmarks first
  int contradicting = 0;                   // pairs of overlapping keyframes whose depths contradict the placement
};

// Receives how many of all keyframes of B are compared with A.
using MergeProgress = std::function<void(int done, int all)>;

// Places map B in map A by re-identified landmarks, verifies the placement by the depth of all overlapping keyframes, and
// optimises both maps together. Throws Error, beginning with `b_name`, if fewer than two views of B are re-identified with
// the same placement, if another placement explains as many, or if the depths contradict it. Both maps are of the same
// camera.
MergedMap merge_maps(const KeyframeMap& a, const KeyframeMap& b, const MapperOptions& options,
                     const std::string& b_name, const MergeProgress& progress = {});

}  // namespace fringeslam
