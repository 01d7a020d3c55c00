// SPDX-License-Identifier: Apache-2.0
// The scene's geometry in an Embree BVH. Embree finds which triangle a ray meets, in single precision;
// where it meets it is then computed in double precision, t = n.(v0 - o) / (n.d), so that depth is
// exact to rounding and figures of the pipeline are not limited by the renderer.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

struct Hit {
  double distance = 0;                               // in units of the direction's length
  Eigen::Vector3d point = Eigen::Vector3d::Zero();   // world, m
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, world, towards the ray's origin
  int object = 0;                                    // index into Scene::objects
};

class RayWorld {
 public:
  explicit RayWorld(const Scene& scene);
  ~RayWorld();
  RayWorld(RayWorld&&) noexcept;

  std::optional<Hit> trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  // True when something lies strictly between a surface point and `target`.
  bool occluded(const Hit& from, const Eigen::Vector3d& target) const;

  // Surface albedo at a hit.
  double albedo(const Hit& hit) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
