// SPDX-License-Identifier: Apache-2.0
// The world as a picture from outside shows it: opened where walls, roofs or heaps would hide what the picture is of.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "sim/light/ray_world.h"

namespace fringeslam::sim {

struct Box {
  Eigen::Vector3d low, high;  // world, m
  Eigen::Vector3d centre() const { return (low + high) / 2; }
};

class OpenedWorld {
 public:
  // With a window, rays that go through it see nothing of what lies in front of it, nor, up to its middle, triangles
  // that turn their backs: the near walls of a room, and the insides of what the window's faces cut.
  OpenedWorld(const Scene& scene, const RayWorld& world, std::optional<Box> window = std::nullopt)
      : scene_(scene), world_(world), window_(std::move(window)) {}

  // As RayWorld::trace, of directions of unit length.
  void trace(const RayPacket& rays, HitPacket& hits) const;

 private:
  bool shows_its_back(const HitPacket& hits, int lane, const Eigen::Vector3d& direction) const;

  const Scene& scene_;
  const RayWorld& world_;
  std::optional<Box> window_;
};

}  // namespace fringeslam::sim
