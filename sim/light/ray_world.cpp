// SPDX-License-Identifier: Apache-2.0
#include "sim/light/ray_world.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "core/types/error.h"

namespace fringeslam::sim {

namespace {

// One object's triangles in the world frame, in double precision.
struct WorldMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3i> triangles;
  Pose object_from_world;
};

void throw_embree_error(void*, RTCError code, const char* message) {
  throw Error("Embree: error " + std::to_string(code) + ": " + (message ? message : "no message"));
}

}  // namespace

struct RayWorld::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<WorldMesh> meshes;
  std::vector<Material> materials;
  std::vector<uint32_t> texture_seeds;

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }

  void add(const Object& object) {
    WorldMesh mesh;
    mesh.object_from_world = object.world_from_object.inverse();
    mesh.triangles = object.mesh.triangles;
    for (const Eigen::Vector3d& vertex : object.mesh.vertices)
      mesh.vertices.push_back(object.world_from_object * vertex);

    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* positions = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
    for (const Eigen::Vector3d& v : mesh.vertices) {
      for (int i = 0; i < 3; ++i) *positions++ = static_cast<float>(v[i]);
    }
    auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                   3 * sizeof(unsigned), mesh.triangles.size()));
    for (const Eigen::Vector3i& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) *indices++ = static_cast<unsigned>(t[i]);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);  // ids count up from 0, as our meshes do
    rtcReleaseGeometry(geometry);
    meshes.push_back(std::move(mesh));
    materials.push_back(object.material);
    texture_seeds.push_back(object.texture_seed);
  }
};

RayWorld::RayWorld(const Scene& scene) : impl_(std::make_unique<Impl>()) {
  impl_->device = rtcNewDevice(nullptr);
  if (!impl_->device) throw Error("Embree: no device; this processor lacks what Embree needs (SSE2)");
  rtcSetDeviceErrorFunction(impl_->device, throw_embree_error, nullptr);
  impl_->scene = rtcNewScene(impl_->device);
  // Robust: rays do not slip between two triangles along their common edge.
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  for (const Object& object : scene.objects) impl_->add(object);
  // Built by one thread: the tree, and with it which of two triangles a ray on their common edge meets, must not
  // depend on the number of threads.
  tbb::task_arena(1).execute([this] { rtcCommitScene(impl_->scene); });
}

RayWorld::~RayWorld() = default;
RayWorld::RayWorld(RayWorld&&) noexcept = default;

std::optional<Hit> RayWorld::trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
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
  rtcIntersect1(impl_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;

  const WorldMesh& mesh = impl_->meshes[query.hit.geomID];
  const Eigen::Vector3i& t = mesh.triangles[query.hit.primID];
  const Eigen::Vector3d& v0 = mesh.vertices[static_cast<size_t>(t[0])];
  const Eigen::Vector3d edge1 = mesh.vertices[static_cast<size_t>(t[1])] - v0;
  const Eigen::Vector3d edge2 = mesh.vertices[static_cast<size_t>(t[2])] - v0;
  Hit hit;
  hit.normal = edge1.cross(edge2).normalized();
  if (hit.normal.dot(direction) > 0) hit.normal = -hit.normal;
  hit.distance = hit.normal.dot(v0 - origin) / hit.normal.dot(direction);
  // At grazing incidence the double-precision plane may be met far from the triangle that was hit.
  if (!(std::abs(hit.distance - static_cast<double>(query.ray.tfar)) < 1e-4 * (1 + std::abs(hit.distance))))
    hit.distance = static_cast<double>(query.ray.tfar);
  hit.point = origin + hit.distance * direction;
  hit.object = static_cast<int>(query.hit.geomID);
  return hit;
}

bool RayWorld::occluded(const Hit& from, const Eigen::Vector3d& target) const {
  // Lift the start off the surface by more than single precision's resolution of the scene.
  const Eigen::Vector3d origin = from.point + 2e-6 * (1 + from.point.norm()) * from.normal;
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

double RayWorld::albedo(const Hit& hit) const {
  const auto object = static_cast<size_t>(hit.object);
  return impl_->materials[object].albedo_at(impl_->meshes[object].object_from_world * hit.point,
                                            impl_->texture_seeds[object]);
}

}  // namespace fringeslam::sim
