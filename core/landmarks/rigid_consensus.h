// SPDX-License-Identifier: Apache-2.0
// The rigid motion that most of a set of point pairs agree with.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

struct SpreadPair {
  Eigen::Vector3d earlier, current;  // m
  double sigma = 0;                  // of a coordinate of their difference, m
};

struct RigidConsensus {
  Pose earlier_from_current;
  std::vector<int> inliers;  // of the pairs, those within `inlier_sigma` sigmas
};

// From triples of pairs whose triangles are alike: all triples of up to 14 pairs, else `random_triples` of them, always
// the same. Refined over the inliers by weighted least squares. No inliers when no three pairs agree.
RigidConsensus rigid_consensus(const std::vector<SpreadPair>& pairs, double inlier_sigma, int random_triples = 400);

}  // namespace fringeslam
