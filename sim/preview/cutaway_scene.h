// SPDX-License-Identifier: Apache-2.0
// Cutaway view of a scene: removes walls, roofs or piles that would occlude the region of interest from outside.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "sim/light/ray_scene.h"

namespace fringeslam::sim {

struct Box {
  Eigen::Vector3d low, high;  // world, m
  Eigen::Vector3d centre() const { return (low + high) / 2; }
};

class CutawayScene {
 public:
  // With a window, a ray that enters it ignores everything in front of the window and, up to the window's centre,
  // back-facing triangles: the near walls of a room and the insides of objects cut by the window's faces.
  CutawayScene(const Scene& scene, const RayScene& world, std::optional<Box> window = std::nullopt)
      : scene_(scene), world_(world), window_(std::move(window)) {}

  // Same as RayScene::trace; directions must have unit length.
  void trace(const RayPacket& rays, HitPacket& hits) const;

 private:
  bool is_back_facing(const HitPacket& hits, int lane, const Eigen::Vector3d& direction) const;

  const Scene& scene_;
  const RayScene& world_;
  std::optional<Box> window_;
};

}  // namespace fringeslam::sim
