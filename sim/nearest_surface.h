// SPDX-License-Identifier: Apache-2.0
// Exact point-to-surface distances, used for scoring maps (docs/method.md, section 13). An Embree point query finds the
// candidate triangles in single precision; their distances are computed in double precision, so the minimum is exact to
// rounding, independent of the BVH.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

class NearestSurface {
 public:
  // Collects the triangles of every object of the scene, transformed to the world frame.
  explicit NearestSurface(const Scene& scene);
  // Uses a mesh given in the world frame.
  explicit NearestSurface(Mesh mesh);
  ~NearestSurface();
  NearestSurface(NearestSurface&&) noexcept;

  // Returns the distance, m, from a point in the world frame to the nearest triangle; infinite if none lies within
  // `within_m`.
  double distance_m(const Eigen::Vector3d& point, double within_m) const;
  // Same for many points, in parallel.
  std::vector<double> distances_m(const std::vector<Eigen::Vector3d>& points, double within_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
