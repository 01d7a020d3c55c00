// SPDX-License-Identifier: Apache-2.0
// Mass properties of a convex body.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam::sim {

struct MassProperties {
  double volume = 0;                                 // m^3
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // centre of mass, m
};

// Computes the volume and centre of mass of the convex hull of `corners` (m) at uniform density.
MassProperties mass_properties_of(const std::vector<Eigen::Vector3d>& corners);

}  // namespace fringeslam::sim
