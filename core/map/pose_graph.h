// SPDX-License-Identifier: Apache-2.0
// Poses from relative measurements including loop closures (docs/method.md, section 8.1): drift is bounded where the
// robot returns.
//
// With A and B the poses world_from_node of an edge's ends and Z its measurement from_from_to,
//
//   min sum w_e || Lambda_e^(1/2) difference(A^-1 B, Z_e) ||^2
//
// by Levenberg-Marquardt over sparse Cholesky factors (Ceres). Loop closures may be false, and a single false loop
// distorts the whole map. Their weights w_e, 1 (accepted) or 0 (rejected), are determined in three steps:
//   1. Test against the non-loop edges alone: chi^2 = d^T (Lambda^-1 + H P H^T)^-1 d, with d the loop's residual at
//      their solution and H P H^T the remaining uncertainty between the loop's ends, rejects loops that drift cannot
//      explain.
//   2. Graduated non-convexity with truncated least squares among the others (H. Yang et al., Graduated non-convexity
//      for robust spatial perception, RA-L 2020).
//   3. The same chi^2 against all accepted edges, which a loop fails that merely bent a weakly constrained chain: the
//      worst loops are rejected, wrongly rejected ones are accepted again, until nothing changes. Each change lowers
//      the sum of squares plus loop_sigma^2 per rejected loop.
// When a growing map is optimised again, the selection of the previous time is kept if it rejected few loops, the new ones
// pass the test of step 3, and no loop in use lies beyond its limit.
// Results do not depend on the number of threads.
#pragma once

#include <vector>

#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

struct PoseEdge {
  int from = 0, to = 0;
  Pose from_from_to;
  Matrix6d information = Matrix6d::Zero();  // in the tangent of retract() at from_from_to; may be singular
  bool loop = false;                        // loops may be false; other edges are trusted
};

struct PoseGraphOptions {
  int max_iterations = 100;
  bool reject_loops = true;
  double loop_sigma = 6;  // a chi-square of 6 degrees of freedom exceeds 36 once in 400,000

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_iterations", max_iterations, {1, 10000},
            "largest number of Levenberg-Marquardt iterations per solution");
    v.field("reject_loops", reject_loops, "reject false loop closures");
    v.field("loop_sigma", loop_sigma, {1, 1000}, "Mahalanobis distance beyond which a loop closure is rejected");
  }
};

struct PoseGraphResult {
  bool converged = false;
  int iterations = 0;  // of all solutions
  // Half the weighted sum of squares at the initial poses and at the result, with the same weights. Twice `cost` is
  // chi-square distributed if the information matrices are correct.
  double initial_cost = 0, cost = 0;
  std::vector<Pose> poses;      // world_from_node
  std::vector<double> weights;  // per edge: 1 = accepted, 0 = rejected loop
  bool all_tested = true;       // false if the selection of an earlier optimisation was kept
};

// Optimises the poses; `initial` is world_from_node of each node. The first node of each connected part is fixed (node
// 0 in particular), so nodes without edges stay in place. Throws Error if a pose or an information matrix is not
// finite, an information matrix is not symmetric or has a negative eigenvalue, an edge does not join two nodes, or
// options are out of range. `earlier_weights` are those of an earlier result for the first of the edges, near whose poses
// `initial` lies; then most of the tests can be left out.
PoseGraphResult optimise_poses(const std::vector<Pose>& initial, const std::vector<PoseEdge>& edges,
                               const PoseGraphOptions& options, const std::vector<double>& earlier_weights = {});

}  // namespace fringeslam
