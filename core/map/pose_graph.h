// SPDX-License-Identifier: Apache-2.0
// Poses from measurements between them, loop closures included (METHOD S23): drift is bounded where the robot returns.
//
// With A and B the poses world_from_node of an edge's ends and Z its measurement from_from_to,
//
//   min sum w_e || Lambda_e^(1/2) difference(A^-1 B, Z_e) ||^2
//
// by Levenberg-Marquardt over sparse Cholesky factors (Ceres). A loop closure may be false, and one false loop bends
// the whole map. Which are believed, w_e = 1 or 0, is chosen in three steps:
//   1. Against the other edges alone: chi^2 = d^T (Lambda^-1 + H P H^T)^-1 d, d the loop's residual at their solution
//      and H P H^T what that leaves open between the loop's ends, rejects what no drift explains.
//   2. Graduated non-convexity with truncated least squares among the rest (H. Yang et al., Graduated non-convexity for
//      robust spatial perception, RA-L 2020).
//   3. The same chi^2 against everything that is believed, which a loop that bent a slack chain to itself does not
//      pass: the worst goes, wrongly rejected ones return, until none changes. Each change lowers the sum of squares
//      plus loop_sigma^2 for each rejected loop.
// Results do not depend on threads.
#pragma once

#include <vector>

#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

struct PoseEdge {
  int from = 0, to = 0;
  Pose from_from_to;
  Matrix6d information = Matrix6d::Zero();  // in the tangent of retract() at from_from_to; may be singular
  bool loop = false;                        // may be false; the others are believed
};

struct PoseGraphOptions {
  int max_iterations = 100;
  bool reject_loops = true;
  double loop_sigma = 6;  // 36 is exceeded by a chi-square of 6 degrees of freedom once in 400,000

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_iterations", max_iterations, {1, 10000}, "Levenberg-Marquardt iterations of a solution");
    v.field("reject_loops", reject_loops, "loop closures may be false");
    v.field("loop_sigma", loop_sigma, {1, 1000}, "Mahalanobis distance beyond which a loop closure is false");
  }
};

struct PoseGraphResult {
  bool converged = false;
  int iterations = 0;  // of all solutions
  // Half the weighted sum of squares, with the same weights at the initial poses and at the result. Twice `cost` is
  // chi-square distributed when the informations are right.
  double initial_cost = 0, cost = 0;
  std::vector<Pose> poses;      // world_from_node
  std::vector<double> weights;  // of each edge: 1 = believed, 0 = a loop that was rejected
};

// `initial`: world_from_node of each node. Node 0 is held, and the first node of every other connected part of the
// graph, so nodes without edges stay where they are. Throws Error when a pose or an information matrix is not finite,
// an information matrix is not symmetric or has a negative eigenvalue, or an edge does not join two nodes.
PoseGraphResult optimise_poses(const std::vector<Pose>& initial, const std::vector<PoseEdge>& edges,
                               const PoseGraphOptions& options);

}  // namespace fringeslam
