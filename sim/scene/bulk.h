// SPDX-License-Identifier: Apache-2.0
// What of a convex body does not depend on how it moves.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam::sim {

// Volume (m^3) and centre of mass of a convex hull.
struct Bulk {
  double volume = 0;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
};

// Of the convex hull of corner points.
Bulk bulk_of(const std::vector<Eigen::Vector3d>& corners);

}  // namespace fringeslam::sim
