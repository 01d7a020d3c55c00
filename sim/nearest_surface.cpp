// SPDX-License-Identifier: Apache-2.0
#include "sim/nearest_surface.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/parallel.h"
#include "sim/light/embree_device.h"

namespace fringeslam::sim {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Relative enlargement of the search radius, times (1 m + distance from the world origin + requested radius). It
// exceeds the error that rounding to single precision adds to the distance between a point and a triangle.
constexpr double kSlack = 1e-6;
constexpr int kTogether = 256;  // points per parallel task

double squared_distance_to_edge(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d along = b - a;
  const double length2 = along.squaredNorm();
  const double share = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0;
  return (p - a - share * along).squaredNorm();
}

// Squared point-triangle distance: to the plane if the point projects inside the triangle, else to the nearest edge.
// A degenerate triangle is treated as its edges.
double squared_distance(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                        const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double area2 = normal.squaredNorm();
  const auto inside = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    return (to - from).cross(p - from).dot(normal) >= 0;
  };
  if (area2 > 0 && inside(a, b) && inside(b, c) && inside(c, a)) {
    const double height = (p - a).dot(normal);
    return height * height / area2;
  }
  return std::min(
      {squared_distance_to_edge(p, a, b), squared_distance_to_edge(p, b, c), squared_distance_to_edge(p, c, a)});
}

Mesh all_objects(const Scene& scene) {
  Mesh all;
  for (const Object& object : scene.objects) {
    if (object.material.pane) continue;  // the sensor looks through it
    const int first = static_cast<int>(all.vertices.size());
    for (const Eigen::Vector3d& vertex : object.mesh->vertices)
      all.vertices.push_back(object.world_from_object * vertex);
    for (const Eigen::Vector3i& triangle : object.mesh->triangles) all.triangles.emplace_back(triangle.array() + first);
  }
  return all;
}

}  // namespace

struct NearestSurface::Impl {
  // State of one point query, passed to Embree's callback.
  struct Search {
    const Mesh* mesh;
    Eigen::Vector3d point;
    double slack_m, best2;
  };

  Impl() = default;
  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void attach() const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* positions = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
    for (const Eigen::Vector3d& v : mesh.vertices) {
      for (int i = 0; i < 3; ++i) *positions++ = static_cast<float>(v[i]);
    }
    static_assert(sizeof(Eigen::Vector3i) == 3 * sizeof(unsigned));
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               sizeof(Eigen::Vector3i), mesh.triangles.size());
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
  }

  static bool look_at(RTCPointQueryFunctionArguments* arguments) {
    Search& search = *static_cast<Search*>(arguments->userPtr);
    const Eigen::Vector3i& t = search.mesh->triangles[arguments->primID];
    const auto vertex = [&](int i) -> const Eigen::Vector3d& {
      return search.mesh->vertices[static_cast<size_t>(t[i])];
    };
    const double distance2 = squared_distance(search.point, vertex(0), vertex(1), vertex(2));
    if (!(distance2 < search.best2)) return false;
    search.best2 = distance2;
    arguments->query->radius = static_cast<float>(std::sqrt(distance2) + search.slack_m);
    return true;
  }

  double distance_m(const Eigen::Vector3d& point, double within_m) const {
    Search search{&mesh, point, kSlack * (1 + point.norm() + (std::isinf(within_m) ? 0 : within_m)), kInfinity};
    RTCPointQuery query{};
    query.x = static_cast<float>(point.x());
    query.y = static_cast<float>(point.y());
    query.z = static_cast<float>(point.z());
    query.radius = static_cast<float>(within_m + search.slack_m);
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(scene, &query, &context, look_at, &search);
    const double distance = std::sqrt(search.best2);
    return distance <= within_m ? distance : kInfinity;
  }

  Mesh mesh;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
};

NearestSurface::NearestSurface(const Scene& scene) : NearestSurface(all_objects(scene)) {}
NearestSurface::NearestSurface(Mesh mesh) : impl_(std::make_unique<Impl>()) {
  impl_->mesh = std::move(mesh);
  impl_->device = new_embree_device();
  impl_->scene = rtcNewScene(impl_->device);
  if (!impl_->mesh.triangles.empty()) impl_->attach();
  // Built in a separate single-thread arena, as in RayScene, so that Embree leaves the caller's threads alone.
  tbb::task_arena(1).execute([this] { rtcCommitScene(impl_->scene); });
}
NearestSurface::~NearestSurface() = default;
NearestSurface::NearestSurface(NearestSurface&&) noexcept = default;

double NearestSurface::distance_m(const Eigen::Vector3d& point, double within_m) const {
  return impl_->distance_m(point, within_m);
}

std::vector<double> NearestSurface::distances_m(const std::vector<Eigen::Vector3d>& points, double within_m) const {
  std::vector<double> distances(points.size());
  for_each_row(static_cast<int>((points.size() + kTogether - 1) / kTogether), [&](int piece) {
    const size_t first = static_cast<size_t>(piece) * kTogether;
    for (size_t i = first; i < std::min(first + kTogether, points.size()); ++i)
      distances[i] = impl_->distance_m(points[i], within_m);
  });
  return distances;
}

}  // namespace fringeslam::sim
