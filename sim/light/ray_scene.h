// SPDX-License-Identifier: Apache-2.0
// Ray tracing of the scene with an Embree BVH. Embree finds the triangle hit by a ray in single precision; the hit
// point is then computed in double precision, t = (n.v0 - n.o) / (n.d). Depth is therefore exact to rounding, and the
// renderer does not limit the measured accuracy of the pipeline.
//
// Rays are traced in packets of kPacket. They pass panes (sim/light/panes.h).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "sim/scene/scene.h"

struct RTCSceneTy;

namespace fringeslam::sim {

inline constexpr int kPacket = 16;
using LaneMask = uint32_t;  // one bit per lane
inline constexpr LaneMask kAllLanes = (1u << kPacket) - 1;
inline bool has(LaneMask lanes, int lane) { return (lanes >> lane & 1) != 0; }

struct Hit {
  double distance = 0;                               // in units of the direction's length
  Eigen::Vector3d point = Eigen::Vector3d::Zero();   // world, m
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, world, towards the ray's origin
  int object = 0;                                    // index into Scene::objects
};

// One 3D point or vector per lane.
struct alignas(64) Points {
  double x[kPacket], y[kPacket], z[kPacket];
  Eigen::Vector3d at(int lane) const { return {x[lane], y[lane], z[lane]}; }
  void set(int lane, const Eigen::Vector3d& p) { x[lane] = p.x(), y[lane] = p.y(), z[lane] = p.z(); }
};

struct RayPacket {
  Points origin, direction;
  LaneMask active = 0;
  bool coherent = true;  // rays have similar origins and directions; a hint for Embree
};

struct HitPacket {
  alignas(64) double distance[kPacket];
  Points point, normal;
  int object[kPacket], triangle[kPacket];
  float u[kPacket], v[kPacket];  // barycentric weights of the triangle's second and third vertex
  LaneMask hit = 0;              // lanes that hit; the members of other lanes are undefined
};

class RayScene {
 public:
  explicit RayScene(const Scene& scene);
  ~RayScene();
  RayScene(RayScene&&) noexcept;

  // Returns the first hit of a ray, world frame; none if it misses.
  std::optional<Hit> trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;
  // Same for a packet of rays.
  void trace(const RayPacket& rays, HitPacket& hits) const;

  // True if a surface lies strictly between a surface point and `target`.
  bool occluded(const Hit& from, const Eigen::Vector3d& target) const;
  // Returns the occluded lanes. Points on surfaces must be lifted() first.
  LaneMask occluded(const Points& from, LaneMask active, const Eigen::Vector3d& target) const;

  // Returns the hit points offset along their normals by more than the single-precision resolution at that position.
  static Points lifted(const HitPacket& hits);

  // Underlying Embree scene, for benchmarks (RayTracingBaseline).
  RTCSceneTy* embree_scene() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
