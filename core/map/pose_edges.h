// SPDX-License-Identifier: Apache-2.0
// Linearisation of pose-graph edges, and the test of a loop closure against the rest of the graph; see pose_graph.h.
#pragma once

#include <optional>
#include <vector>

#include "core/map/pose_graph.h"

namespace fringeslam {

// Returns the symmetric square root of an information matrix. Throws Error, naming the edge, if there is none.
Matrix6d information_root(const Matrix6d& information, size_t edge);

struct LinearEdge {
  Vector6d residual;        // root * difference(A^-1 B, Z), in sigmas
  Matrix6d by_from, by_to;  // its derivatives with respect to the tangents of A and B
};

// With E = A^-1 B, R_E' = Exp(-R_A^T omega_A) R_E and t_E' = t_E + R_A^T (t_B - t_A) x omega_A - R_A^T v_A; the terms
// of B have the opposite sign and no cross product. J_l^-1 maps the rotation of R_E to its logarithm.
LinearEdge linearise(const PoseEdge& edge, const Matrix6d& root, const Pose& world_from_from,
                     const Pose& world_from_to);

// Returns for each node the lowest node connected to it by the edges in use.
std::vector<int> connected_parts(size_t nodes, const std::vector<PoseEdge>& edges, const std::vector<char>& use);

// Returns chi^2 (6 degrees of freedom) of each loop closure against all other edges in use, whether or not it is in
// use itself, at their solution `poses`; 0 for a loop that alone connects two parts, and for edges that are not loops.
std::vector<double> loop_chi2(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges,
                              const std::vector<Matrix6d>& roots, const std::vector<char>& use);

struct RefinedPoses {
  std::vector<Pose> poses;
  // One per edge. For a loop from number `first` on: chi^2 as in loop_chi2(), with the covariance linearised at `near`. For an
  // earlier loop in use: its squared residual in sigmas, a lower bound of chi^2. Otherwise 0.
  std::vector<double> chi2;
  int steps = 0;
};

// Solves for poses near `near` with the edges in use, by Gauss-Newton steps with the factor at `near`. Returns nothing if they
// do not converge.
std::optional<RefinedPoses> refined_poses(const std::vector<Pose>& near, const std::vector<PoseEdge>& edges,
                                          const std::vector<Matrix6d>& roots, const std::vector<char>& use, size_t first);

// Returns the covariance of a node's pose at the solution `poses`, tangent of retract(), relative to the first node of its
// part, which is fixed. Directions that no edge in use determines have very large variances.
Matrix6d covariance_of_node(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges,
                            const std::vector<char>& use, int node);

}  // namespace fringeslam
