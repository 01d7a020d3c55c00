// SPDX-License-Identifier: Apache-2.0
// Robust estimation of the rigid motion that most of a set of point pairs support.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

struct WeightedPair {
  Eigen::Vector3d earlier, current;  // m
  double sigma = 0;                  // standard deviation of each coordinate of their difference, m
};

struct RigidConsensus {
  Pose earlier_from_current;
  std::vector<int> inliers;  // indices of the pairs within `inlier_sigma` sigmas
};

// Estimates the motion from triples of pairs with congruent triangles: all triples of up to 14 pairs, else up to
// `random_triples` of them from a fixed seed. The best hypothesis is refined over its inliers by weighted least
// squares. Without three consistent pairs there are no inliers.
RigidConsensus rigid_consensus(const std::vector<WeightedPair>& pairs, double inlier_sigma, int random_triples = 400);

}  // namespace fringeslam
