// SPDX-License-Identifier: Apache-2.0
// The scene's geometry in an Embree BVH. Embree finds which triangle a ray meets, in single precision;
// where it meets it is then computed in double precision, t = (n.v0 - n.o) / (n.d), so that depth is
// exact to rounding and figures of the pipeline are not limited by the renderer.
//
// Rays travel in packets of kPacket.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "sim/scene/scene.h"

struct RTCSceneTy;

namespace fringeslam::sim {

inline constexpr int kPacket = 16;
using Lanes = uint32_t;  // a bit a lane
inline constexpr Lanes kAllLanes = (1u << kPacket) - 1;
inline bool has(Lanes lanes, int lane) { return (lanes >> lane & 1) != 0; }

struct Hit {
  double distance = 0;                               // in units of the direction's length
  Eigen::Vector3d point = Eigen::Vector3d::Zero();   // world, m
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, world, towards the ray's origin
  int object = 0;                                    // index into Scene::objects
};

// Three coordinates of each lane.
struct alignas(64) Points {
  double x[kPacket], y[kPacket], z[kPacket];
  Eigen::Vector3d at(int lane) const { return {x[lane], y[lane], z[lane]}; }
  void set(int lane, const Eigen::Vector3d& p) { x[lane] = p.x(), y[lane] = p.y(), z[lane] = p.z(); }
};

struct RayPacket {
  Points origin, direction;
  Lanes active = 0;
  bool coherent = true;  // neighbours go much the same way
};

struct HitPacket {
  alignas(64) double distance[kPacket];
  Points point, normal;
  int object[kPacket], triangle[kPacket];
  float u[kPacket], v[kPacket];  // barycentric, of the triangle's second and third vertex
  Lanes hit = 0;                 // the rest is undefined in the other lanes
};

class RayWorld {
 public:
  explicit RayWorld(const Scene& scene);
  ~RayWorld();
  RayWorld(RayWorld&&) noexcept;

  std::optional<Hit> trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;
  void trace(const RayPacket& rays, HitPacket& hits) const;

  // True when something lies strictly between a surface point and `target`.
  bool occluded(const Hit& from, const Eigen::Vector3d& target) const;
  // The lanes in which something does. Points of surfaces are to be lifted off them first.
  Lanes occluded(const Points& from, Lanes active, const Eigen::Vector3d& target) const;

  // Surface points moved off their surfaces by more than single precision's resolution of the scene.
  static Points lifted(const HitPacket& hits);

  // For measurements of the bare rays.
  RTCSceneTy* embree_scene() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
