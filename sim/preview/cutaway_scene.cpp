// SPDX-License-Identifier: Apache-2.0
#include "sim/preview/cutaway_scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace fringeslam::sim {

namespace {

// Returns the distance at which a ray enters a box; 0 if it starts inside, none if it misses the box.
std::optional<double> entry(const Box& box, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  double first = 0, last = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const double a = (box.low[i] - origin[i]) / direction[i], b = (box.high[i] - origin[i]) / direction[i];
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  if (!(first <= last)) return std::nullopt;
  return first;
}

void copy_lane(const HitPacket& from, int lane, HitPacket& to) {
  to.distance[lane] = from.distance[lane];
  to.point.set(lane, from.point.at(lane));
  to.normal.set(lane, from.normal.at(lane));
  to.object[lane] = from.object[lane];
  to.triangle[lane] = from.triangle[lane];
  to.u[lane] = from.u[lane];
  to.v[lane] = from.v[lane];
}

}  // namespace

bool CutawayScene::is_back_facing(const HitPacket& hits, int lane, const Eigen::Vector3d& direction) const {
  const Object& object = scene_.objects[static_cast<size_t>(hits.object[lane])];
  const Eigen::Vector3i& t = object.mesh->triangles[static_cast<size_t>(hits.triangle[lane])];
  const auto vertex = [&](int i) -> const Eigen::Vector3d& { return object.mesh->vertices[static_cast<size_t>(t[i])]; };
  const Eigen::Vector3d outside = (vertex(1) - vertex(0)).cross(vertex(2) - vertex(0));
  return (object.world_from_object.rotation * outside).dot(direction) > 0;
}

void CutawayScene::trace(const RayPacket& rays, HitPacket& hits) const {
  if (!window_) return world_.trace(rays, hits);
  constexpr int kMostBacks = 16;
  RayPacket from = rays;
  double start[kPacket] = {}, middle[kPacket] = {};
  for (int i = 0; i < kPacket; ++i) {
    const Eigen::Vector3d origin = rays.origin.at(i), direction = rays.direction.at(i);
    const auto enters = entry(*window_, origin, direction);
    if (!has(rays.active, i) || !enters) continue;
    start[i] = *enters;
    middle[i] = direction.dot(window_->centre() - origin);
    from.origin.set(i, origin + start[i] * direction);
  }
  world_.trace(from, hits);
  const auto turned_away = [&](LaneMask lanes) {
    LaneMask backs = 0;
    for (int i = 0; i < kPacket; ++i) {
      if (has(lanes & hits.hit, i) && start[i] + hits.distance[i] < middle[i] &&
          is_back_facing(hits, i, rays.direction.at(i)))
        backs |= 1u << i;
    }
    return backs;
  };
  LaneMask backs = turned_away(kAllLanes);
  for (int round = 0; backs != 0 && round < kMostBacks; ++round) {
    const Points lifted = RayScene::lifted(hits);  // lifted towards the viewer; continue from the opposite side
    for (int i = 0; i < kPacket; ++i) {
      if (!has(backs, i)) continue;
      start[i] += hits.distance[i] + 2 * (lifted.at(i) - hits.point.at(i)).norm();
      from.origin.set(i, rays.origin.at(i) + start[i] * rays.direction.at(i));
    }
    from.active = backs;
    HitPacket behind;
    world_.trace(from, behind);
    for (int i = 0; i < kPacket; ++i) {
      if (has(backs, i)) copy_lane(behind, i, hits);
    }
    hits.hit = (hits.hit & ~backs) | (behind.hit & backs);
    backs = turned_away(backs);
  }
  for (int i = 0; i < kPacket; ++i) hits.distance[i] += start[i];
}

}  // namespace fringeslam::sim
