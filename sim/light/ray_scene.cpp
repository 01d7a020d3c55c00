// SPDX-License-Identifier: Apache-2.0
#include "sim/light/ray_scene.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <map>

#include "core/types/selected_instruction_set.h"
#include "sim/light/embree_device.h"

namespace fringeslam::sim {

namespace {

// Plane n.x = offset of a triangle; the unit normal n points to the side from which the triangle is counter-clockwise.
struct Plane {
  double x, y, z, offset;
};

// Planes of a mesh's triangles, in the frame of the mesh in Embree.
using Planes = std::vector<Plane>;

// Meshes with fewer triangles are copied, which is faster to trace than an instance.
constexpr size_t kLeastInstanced = 64;

}  // namespace

struct RayScene::Impl {
  // Mesh used by several objects; stored once, in its own frame.
  struct Shared {
    RTCScene scene = nullptr;
    std::shared_ptr<const Planes> planes;
  };
  struct Placed {
    std::shared_ptr<const Planes> planes;
    std::optional<Pose> world_from_planes;  // none if the planes are in the world frame
  };

  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::map<const Mesh*, Shared> shared;
  std::vector<Placed> placed;  // by object

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    for (const auto& [mesh, part] : shared) rtcReleaseScene(part.scene);
    if (device) rtcReleaseDevice(device);
  }

  RTCScene new_scene() const {
    RTCScene made = rtcNewScene(device);
    // Robust mode: rays cannot pass between two triangles along their common edge.
    rtcSetSceneFlags(made, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(made, RTC_BUILD_QUALITY_HIGH);
    return made;
  }

  // Builds with one thread: the BVH, and hence which of two triangles is hit on their common edge, must not depend on
  // the number of threads.
  static void build(RTCScene scene) {
    tbb::task_arena(1).execute([scene] { rtcCommitScene(scene); });
  }

  // The number of a geometry of the scene is the object's index.
  void attach(RTCScene to, RTCGeometry geometry, size_t number) const {
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(to, geometry, static_cast<unsigned>(number));
    rtcReleaseGeometry(geometry);
  }

  std::shared_ptr<const Planes> add_mesh(RTCScene to, const Mesh& mesh, const Pose& pose, size_t number) const {
    std::vector<Eigen::Vector3d> vertices;
    vertices.reserve(mesh.vertices.size());
    for (const Eigen::Vector3d& vertex : mesh.vertices) vertices.push_back(pose * vertex);

    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* positions = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), vertices.size()));
    for (const Eigen::Vector3d& v : vertices) {
      for (int i = 0; i < 3; ++i) *positions++ = static_cast<float>(v[i]);
    }
    auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                   3 * sizeof(unsigned), mesh.triangles.size()));
    auto planes = std::make_shared<Planes>();
    planes->reserve(mesh.triangles.size());
    for (const Eigen::Vector3i& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) *indices++ = static_cast<unsigned>(t[i]);
      const Eigen::Vector3d& v0 = vertices[static_cast<size_t>(t[0])];
      const Eigen::Vector3d n =
          (vertices[static_cast<size_t>(t[1])] - v0).cross(vertices[static_cast<size_t>(t[2])] - v0).normalized();
      planes->push_back({n.x(), n.y(), n.z(), n.dot(v0)});
    }
    attach(to, geometry, number);
    return planes;
  }

  void add_instance(const std::shared_ptr<const Mesh>& mesh, const Pose& pose) {
    Shared& part = shared[mesh.get()];
    if (!part.scene) {
      part.scene = new_scene();
      part.planes = add_mesh(part.scene, *mesh, Pose{}, 0);
      build(part.scene);
    }
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, part.scene);
    float transform[12];
    for (int col = 0; col < 4; ++col) {
      for (int row = 0; row < 3; ++row)
        transform[3 * col + row] = static_cast<float>(col < 3 ? pose.rotation(row, col) : pose.translation[row]);
    }
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, transform);
    attach(scene, geometry, placed.size());
    placed.push_back({part.planes, pose});
  }

  // False if instances exist: Embree 3 may hang on coherent packets of shadow rays with instances.
  bool coherent_packets() const { return shared.empty(); }

  // Returns the plane of an object's triangle in the world frame.
  Plane plane(int object, unsigned triangle) const {
    const Placed& here = placed[static_cast<size_t>(object)];
    const Plane& plane = (*here.planes)[triangle];
    if (!here.world_from_planes) return plane;
    const Eigen::Vector3d n = here.world_from_planes->rotation * Eigen::Vector3d(plane.x, plane.y, plane.z);
    return {n.x(), n.y(), n.z(), plane.offset + n.dot(here.world_from_planes->translation)};
  }
};

RayScene::RayScene(const Scene& scene) : impl_(std::make_unique<Impl>()) {
  impl_->device = new_embree_device();
  impl_->scene = impl_->new_scene();
  std::map<const Mesh*, int> uses;
  for (const Object& object : scene.objects) ++uses[object.mesh.get()];
  for (const Object& object : scene.objects) {
    if (object.material.pane)
      impl_->placed.emplace_back();  // rays pass
    else if (uses[object.mesh.get()] > 1 && object.mesh->triangles.size() >= kLeastInstanced)
      impl_->add_instance(object.mesh, object.world_from_object);
    else
      impl_->placed.push_back(
          {impl_->add_mesh(impl_->scene, *object.mesh, object.world_from_object, impl_->placed.size()), std::nullopt});
  }
  Impl::build(impl_->scene);
}

RayScene::~RayScene() = default;
RayScene::RayScene(RayScene&&) noexcept = default;

RTCSceneTy* RayScene::embree_scene() const { return impl_->scene; }

namespace {

int object_of(unsigned instance, unsigned geometry) {
  return static_cast<int>(instance == RTC_INVALID_GEOMETRY_ID ? geometry : instance);
}

constexpr double kLift = 2e-6;  // offset from the surface, relative to (1 m + distance from the world origin)

// Packet arithmetic, compiled for each instruction set. Inactive lanes are zero: Embree's coherent traversal on AVX2
// requires finite rays in all lanes.
FRINGESLAM_INLINE void to_query_body(const RayPacket& rays, RTCRayHit16& query, int* valid) {
#pragma GCC ivdep
  for (int i = 0; i < kPacket; ++i) {
    const bool on = rays.active >> i & 1;
    valid[i] = -static_cast<int>(on);
    query.ray.org_x[i] = on ? static_cast<float>(rays.origin.x[i]) : 0;
    query.ray.org_y[i] = on ? static_cast<float>(rays.origin.y[i]) : 0;
    query.ray.org_z[i] = on ? static_cast<float>(rays.origin.z[i]) : 0;
    query.ray.dir_x[i] = on ? static_cast<float>(rays.direction.x[i]) : 0;
    query.ray.dir_y[i] = on ? static_cast<float>(rays.direction.y[i]) : 0;
    query.ray.dir_z[i] = on ? static_cast<float>(rays.direction.z[i]) : 0;
    query.ray.tnear[i] = 0;
    query.ray.tfar[i] = std::numeric_limits<float>::infinity();
    query.ray.time[i] = 0;
    query.ray.mask[i] = ~0u;
    query.ray.flags[i] = 0;
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
}

// Planes of the triangles hit, as structure of arrays.
struct alignas(64) PlanePacket {
  double x[kPacket], y[kPacket], z[kPacket], offset[kPacket];
};

FRINGESLAM_INLINE void refine_body(const RayPacket& rays, const PlanePacket& planes, const float* single,
                                   HitPacket& hits) {
#pragma GCC ivdep
  for (int i = 0; i < kPacket; ++i) {
    const Points &o = rays.origin, &d = rays.direction;
    const double nx = planes.x[i], ny = planes.y[i], nz = planes.z[i];
    const double along = nx * d.x[i] + ny * d.y[i] + nz * d.z[i];
    const double height = planes.offset[i] - (nx * o.x[i] + ny * o.y[i] + nz * o.z[i]);
    const auto coarse = static_cast<double>(single[i]);
    const double exact = height / along;
    // At grazing incidence, the double-precision plane intersection may lie far from the triangle hit.
    const double t = std::abs(exact - coarse) < 1e-4 * (1 + std::abs(exact)) ? exact : coarse;
    const double side = along > 0 ? -1.0 : 1.0;
    hits.distance[i] = t;
    hits.point.x[i] = o.x[i] + t * d.x[i];
    hits.point.y[i] = o.y[i] + t * d.y[i];
    hits.point.z[i] = o.z[i] + t * d.z[i];
    hits.normal.x[i] = side * nx;
    hits.normal.y[i] = side * ny;
    hits.normal.z[i] = side * nz;
  }
}

FRINGESLAM_INLINE void lift_body(const HitPacket& hits, Points& points) {
#pragma GCC ivdep
  for (int i = 0; i < kPacket; ++i) {
    const double x = hits.point.x[i], y = hits.point.y[i], z = hits.point.z[i];
    const double height = kLift * (1 + std::sqrt(x * x + y * y + z * z));
    points.x[i] = x + height * hits.normal.x[i];
    points.y[i] = y + height * hits.normal.y[i];
    points.z[i] = z + height * hits.normal.z[i];
  }
}

FRINGESLAM_INLINE void to_shadow_query_body(const Points& from, const double* target, LaneMask active, RTCRay16& query,
                                            int* valid) {
#pragma GCC ivdep
  for (int i = 0; i < kPacket; ++i) {
    const bool on = active >> i & 1;
    valid[i] = -static_cast<int>(on);
    query.org_x[i] = on ? static_cast<float>(from.x[i]) : 0;
    query.org_y[i] = on ? static_cast<float>(from.y[i]) : 0;
    query.org_z[i] = on ? static_cast<float>(from.z[i]) : 0;
    query.dir_x[i] = on ? static_cast<float>(target[0] - from.x[i]) : 0;
    query.dir_y[i] = on ? static_cast<float>(target[1] - from.y[i]) : 0;
    query.dir_z[i] = on ? static_cast<float>(target[2] - from.z[i]) : 0;
    query.tnear[i] = 0;
    query.tfar[i] = 1;
    query.time[i] = 0;
    query.mask[i] = ~0u;
    query.flags[i] = 0;
  }
}

}  // namespace

void RayScene::trace(const RayPacket& rays, HitPacket& hits) const {
  static const auto to_query = Variants<to_query_body>::of(selected_instruction_set());
  static const auto refine = Variants<refine_body>::of(selected_instruction_set());
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (rays.coherent && impl_->coherent_packets()) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(64) RTCRayHit16 query;
  alignas(64) int valid[kPacket];
  to_query(rays, query, valid);
  rtcIntersect16(valid, impl_->scene, &context, &query);

  PlanePacket planes;
  hits.hit = 0;
  for (int i = 0; i < kPacket; ++i) {
    const bool met = valid[i] && query.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    const int object = met ? object_of(query.hit.instID[0][i], query.hit.geomID[i]) : 0;
    const Plane plane = met ? impl_->plane(object, query.hit.primID[i]) : Plane{0, 0, 1, 0};
    planes.x[i] = plane.x;
    planes.y[i] = plane.y;
    planes.z[i] = plane.z;
    planes.offset[i] = plane.offset;
    hits.object[i] = object;
    hits.triangle[i] = met ? static_cast<int>(query.hit.primID[i]) : 0;
    hits.u[i] = query.hit.u[i];
    hits.v[i] = query.hit.v[i];
    hits.hit |= static_cast<LaneMask>(met) << i;
  }
  refine(rays, planes, query.ray.tfar, hits);
}

std::optional<Hit> RayScene::trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray.org_x = static_cast<float>(origin.x());
  query.ray.org_y = static_cast<float>(origin.y());
  query.ray.org_z = static_cast<float>(origin.z());
  query.ray.dir_x = static_cast<float>(direction.x());
  query.ray.dir_y = static_cast<float>(direction.y());
  query.ray.dir_z = static_cast<float>(direction.z());
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.mask = ~0u;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(impl_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;

  const int object = object_of(query.hit.instID[0], query.hit.geomID);
  const Plane plane = impl_->plane(object, query.hit.primID);
  Hit hit;
  hit.normal = {plane.x, plane.y, plane.z};
  const double along = hit.normal.dot(direction);
  hit.distance = (plane.offset - hit.normal.dot(origin)) / along;
  const auto single = static_cast<double>(query.ray.tfar);
  if (!(std::abs(hit.distance - single) < 1e-4 * (1 + std::abs(hit.distance)))) hit.distance = single;
  if (along > 0) hit.normal = -hit.normal;
  hit.point = origin + hit.distance * direction;
  hit.object = object;
  return hit;
}

Points RayScene::lifted(const HitPacket& hits) {
  static const auto lift = Variants<lift_body>::of(selected_instruction_set());
  Points points;
  lift(hits, points);
  return points;
}

LaneMask RayScene::occluded(const Points& from, LaneMask active, const Eigen::Vector3d& target) const {
  static const auto to_shadow_query = Variants<to_shadow_query_body>::of(selected_instruction_set());
  if (active == 0) return 0;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (impl_->coherent_packets()) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(64) RTCRay16 query;
  alignas(64) int valid[kPacket];
  to_shadow_query(from, target.data(), active, query, valid);
  rtcOccluded16(valid, impl_->scene, &context, &query);
  LaneMask dark = 0;
  for (int i = 0; i < kPacket; ++i) dark |= static_cast<LaneMask>(valid[i] && query.tfar[i] < 0) << i;
  return dark;
}

bool RayScene::occluded(const Hit& from, const Eigen::Vector3d& target) const {
  const Eigen::Vector3d origin = from.point + kLift * (1 + from.point.norm()) * from.normal;
  const Eigen::Vector3d direction = target - origin;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  ray.org_x = static_cast<float>(origin.x());
  ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x());
  ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tnear = 0;
  ray.tfar = 1;
  ray.mask = ~0u;
  rtcOccluded1(impl_->scene, &context, &ray);
  return ray.tfar < 0;
}

}  // namespace fringeslam::sim
