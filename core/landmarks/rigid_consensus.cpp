// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/rigid_consensus.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/base/ransac.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Pair = WeightedPair;

// Returns a triangle's orthonormal axes; false if it is too thin to determine a rotation.
bool triangle_axes(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, double least,
                   Eigen::Matrix3d& axes) {
  const Eigen::Vector3d u = b - a;
  Eigen::Vector3d n = u.cross(c - a);
  const double length = u.norm(), height = n.norm() / std::max(length, 1e-12);
  if (length < least || height < least) return false;
  axes.col(0) = u / length;
  axes.col(2) = n.normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return true;
}

// Estimates the motion from the triangles of three pairs; false if their sides differ by more than the noise.
bool motion_of_three(const Pair& a, const Pair& b, const Pair& c, double inlier_sigma, Pose& motion) {
  const auto same_side = [&](const Pair& p, const Pair& q) {
    const double difference = (p.earlier - q.earlier).norm() - (p.current - q.current).norm();
    return std::abs(difference) <= inlier_sigma * std::hypot(p.sigma, q.sigma);
  };
  if (!same_side(a, b) || !same_side(b, c) || !same_side(a, c)) return false;
  const double least = 4 * std::max({a.sigma, b.sigma, c.sigma});
  Eigen::Matrix3d earlier, current;
  if (!triangle_axes(a.earlier, b.earlier, c.earlier, least, earlier) ||
      !triangle_axes(a.current, b.current, c.current, least, current))
    return false;
  motion.rotation = earlier * current.transpose();
  motion.translation =
      (a.earlier + b.earlier + c.earlier) / 3 - motion.rotation * ((a.current + b.current + c.current) / 3);
  return true;
}

std::vector<int> inliers_of(const std::vector<Pair>& pairs, const Pose& motion, double inlier_sigma) {
  std::vector<int> inliers;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const Pair& pair = pairs[i];
    const double gate = inlier_sigma * pair.sigma;
    if ((pair.earlier - motion * pair.current).squaredNorm() <= gate * gate) inliers.push_back(static_cast<int>(i));
  }
  return inliers;
}

// Least-squares fit weighted by the inverse variances.
Pose fitted(const std::vector<Pair>& pairs, const std::vector<int>& chosen) {
  std::vector<Eigen::Vector3d> earlier, current;
  std::vector<double> variances;
  for (const int i : chosen) {
    const Pair& pair = pairs[static_cast<size_t>(i)];
    earlier.push_back(pair.earlier);
    current.push_back(pair.current);
    variances.push_back(pair.sigma * pair.sigma);
  }
  return align_points(earlier, current, variances);
}

struct TripleHypothesis {
  Pose motion;
  std::vector<int> indices;
  size_t inliers() const { return indices.size(); }
};

}  // namespace

RigidConsensus rigid_consensus(const std::vector<WeightedPair>& pairs, double inlier_sigma, int random_triples) {
  const auto fit = [&](size_t i, size_t j, size_t k) -> std::optional<TripleHypothesis> {
    Pose motion;
    if (!motion_of_three(pairs[i], pairs[j], pairs[k], inlier_sigma, motion)) return std::nullopt;
    return TripleHypothesis{motion, inliers_of(pairs, motion, inlier_sigma)};
  };
  const auto better = [](const TripleHypothesis& a, const TripleHypothesis& b) { return a.inliers() > b.inliers(); };
  const RansacOptions search{.exhaustive_up_to = 14, .max_triples = random_triples, .miss_probability = 1e-4};
  RigidConsensus best;
  if (auto hypothesis = best_of_triples(pairs.size(), search, fit, better); hypothesis && hypothesis->inliers() > 0)
    best = {hypothesis->motion, std::move(hypothesis->indices)};
  for (int round = 0; round < 3 && best.inliers.size() >= 3; ++round) {
    best.earlier_from_current = fitted(pairs, best.inliers);
    best.inliers = inliers_of(pairs, best.earlier_from_current, inlier_sigma);
  }
  return best;
}

}  // namespace fringeslam
