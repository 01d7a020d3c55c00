// SPDX-License-Identifier: Apache-2.0
// Levenberg-Marquardt refinement of an ego-motion with Ceres; see ego_motion.h for the objective.
#pragma once

#include <vector>

#include "core/motion/ego_motion.h"

namespace fringeslam {

struct Refinement {
  Pose previous_from_current;
  Matrix6d information = Matrix6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();  // its inverse; NaN if the pairs leave a direction free
  int iterations = 0;
};

// Returns the covariance of a pair's residual p - R q - t, m^2.
Eigen::Matrix3d pair_covariance(const PointPair& pair, const Pose& previous_from_current);

// Refines the motion over the pairs with use[i] set, starting from `initial`.
Refinement refine_motion(const std::vector<PointPair>& pairs, const std::vector<char>& use, const Pose& initial);

}  // namespace fringeslam
