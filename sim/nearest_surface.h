// SPDX-License-Identifier: Apache-2.0
// How far points are from surfaces: what maps are scored by. Embree's tree finds the triangles that may be the nearest,
// in single precision; the distances to those are computed in double precision, so that the least of them is exact to
// rounding whatever the tree.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

class NearestSurface {
 public:
  // Of all objects, each as often as it stands in the scene.
  explicit NearestSurface(const Scene& scene);
  // Of triangles in the world frame.
  explicit NearestSurface(Mesh mesh);
  ~NearestSurface();
  NearestSurface(NearestSurface&&) noexcept;

  // Least distance of a point in the world frame from any triangle; infinite where none is within `within_m`.
  double distance_m(const Eigen::Vector3d& point, double within_m) const;
  // Of many points at once.
  std::vector<double> distances_m(const std::vector<Eigen::Vector3d>& points, double within_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
