// SPDX-License-Identifier: Apache-2.0
#include "sim/preview/viewpoint.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace fringeslam::sim {

namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Returns the unit direction towards a viewer at the given azimuth and elevation.
Eigen::Vector3d direction_of(double azimuth_deg, double elevation_deg) {
  const double a = azimuth_deg * kDegree, e = elevation_deg * kDegree;
  return {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)};
}

// Returns the rotation of an upright camera that looks along -to_viewer.
Eigen::Matrix3d world_from_view(const Eigen::Vector3d& to_viewer) {
  Eigen::Matrix3d axes;
  axes.col(2) = -to_viewer;
  axes.col(0) = axes.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

void add_spots(const Scene& scene, const RayScene& world, size_t view, int per_side, double farthest_m,
               Interest& interest) {
  const Pinhole& camera = scene.rig.camera;
  const Pose pose = world_from_camera(scene, view);
  for (int i = 0; i < per_side * per_side; ++i) {
    const Eigen::Vector2d pixel((i % per_side + 0.5) / per_side * camera.width - 0.5,
                                (i / per_side + 0.5) / per_side * camera.height - 0.5);
    const Eigen::Vector3d ray = camera.undistort(pixel).homogeneous();
    if (!ray.allFinite()) continue;
    const auto hit = world.trace(pose.translation, pose.rotation * ray);
    if (hit && hit->distance <= farthest_m) interest.spots.push_back({hit->point, hit->normal});
  }
}

// Adds the surface points at the corners of a device's image that lie within `farthest_m`.
void add_corners(const RayScene& world, const Pinhole& device, const Pose& world_from_device, double farthest_m,
                 Interest& interest) {
  for (const Eigen::Vector3d& corner : image_corners(device, 1)) {
    const auto hit = world.trace(world_from_device.translation, world_from_device.rotation * corner);
    if (hit && hit->distance <= farthest_m) interest.corners.push_back(hit->point);
  }
}

// Fractions of the spots and devices visible from a direction, and the mean cosine over all spots, 0 for hidden ones.
struct Sight {
  double spots = 0, facing = 0, devices = 0;
};

class Judge {
 public:
  Judge(const Interest& interest, const CutawayScene& world) : interest_(interest), world_(world) {
    const Box box = interest.box();
    // Far enough that the whole interest lies in front of the viewer; a larger distance would cost single precision.
    away_m_ = 2 * (box.high - box.low).norm() + 1e-3;
  }

  Sight sight(const Eigen::Vector3d& to_viewer) const {
    Sight sight;
    std::vector<Eigen::Vector3d> points;
    for (const Interest::Spot& spot : interest_.spots) points.push_back(spot.point);
    const std::vector<bool> open = seen(points, to_viewer), free = seen(interest_.devices, to_viewer);
    for (size_t i = 0; i < points.size(); ++i) {
      const double cosine = interest_.spots[i].normal.dot(to_viewer);
      if (!open[i] || cosine < 0.05) continue;
      sight.spots += 1.0 / static_cast<double>(points.size());
      sight.facing += cosine / static_cast<double>(points.size());
    }
    for (const bool is_free : free) sight.devices += is_free ? 1.0 / static_cast<double>(free.size()) : 0.0;
    return sight;
  }

 private:
  // Tests the visibility of points from a distance of away_m_ in a direction.
  std::vector<bool> seen(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& to_viewer) const {
    std::vector<bool> result;
    for (size_t first = 0; first < points.size(); first += kPacket) {
      RayPacket rays;
      for (int i = 0; i < kPacket; ++i) {
        const Eigen::Vector3d& point = points[std::min(first + static_cast<size_t>(i), points.size() - 1)];
        rays.origin.set(i, point + away_m_ * to_viewer);
        rays.direction.set(i, -to_viewer);
      }
      rays.active = kAllLanes;
      HitPacket hits;
      world_.trace(rays, hits);
      for (int i = 0; i < kPacket && result.size() < points.size(); ++i)
        result.push_back(!has(hits.hit, i) || hits.distance[i] > away_m_ * (1 - 1e-3));
    }
    return result;
  }

  const Interest& interest_;
  const CutawayScene& world_;
  double away_m_ = 1;
};

// Returns the nearest position e, in the view frame, from which a camera looking along z has all points in its image.
// With the slopes s of the image borders, the constraint |x - e_x| <= s_x (z - e_z) of each point bounds e_x + s_x e_z
// from above and e_x - s_x e_z from below.
Eigen::Vector3d nearest_place(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector2d& slope) {
  Eigen::Vector2d least = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), most = -least;
  for (const Eigen::Vector3d& p : points) {
    least = least.cwiseMin(p.head<2>() + slope * p.z());
    most = most.cwiseMax(p.head<2>() - slope * p.z());
  }
  const double z = ((least - most).array() / (2 * slope.array())).minCoeff();
  return {(least.x() + most.x()) / 2, (least.y() + most.y()) / 2, z};
}

// Returns the square root of the image-area fraction covered by the spots' bounding rectangle.
double fill(const Interest& interest, const Eigen::Vector3d& to_viewer, const Eigen::Vector2d& slope) {
  const Eigen::Matrix3d view_from_world = world_from_view(to_viewer).transpose();
  std::vector<Eigen::Vector3d> turned;
  for (const Eigen::Vector3d& point : interest.points()) turned.push_back(view_from_world * point);
  const Eigen::Vector3d place = nearest_place(turned, slope);
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1), high = -low;
  for (const Interest::Spot& spot : interest.spots) {
    const Eigen::Vector3d p = view_from_world * spot.point - place;
    const Eigen::Vector2d at = p.head<2>().cwiseQuotient(p.z() * slope);
    low = low.cwiseMin(at), high = high.cwiseMax(at);
  }
  return std::sqrt(std::max(0.0, (high - low).prod()) / 4);
}

struct Candidate {
  Eigen::Vector3d to_viewer = Eigen::Vector3d::UnitZ();
  Sight sight;
  double score = -std::numeric_limits<double>::infinity();
};

// Returns the fraction of a vector's length that remains visible after foreshortening.
double across(const Eigen::Vector3d& v, const Eigen::Vector3d& to_viewer) {
  return v.norm() == 0 ? 0 : v.normalized().cross(to_viewer).norm();
}

// Returns the fraction of a vector's length along the image's horizontal axis.
double sideways(const Eigen::Vector3d& v, const Eigen::Vector3d& to_viewer) {
  return v.norm() == 0 ? 0 : std::abs(v.normalized().dot(world_from_view(to_viewer).col(0)));
}

Candidate best_direction(const Scene& scene, const Interest& interest, const CutawayScene& world,
                         const Eigen::Vector2d& slope) {
  const Judge judge(interest, world);
  const Pose camera = world_from_camera(scene, 0);
  const Eigen::Vector3d baseline = world_from_projector(scene, 0).translation - camera.translation;
  Candidate best;
  for (const double elevation : {45, 35, 55, 65, 25, -30, -50}) {
    for (int azimuth = -60; azimuth < 300; azimuth += 15) {
      Candidate here{direction_of(azimuth, elevation), {}, 0};
      here.sight = judge.sight(here.to_viewer);
      here.score = here.sight.spots + 0.5 * here.sight.facing + 0.5 * here.sight.devices +
                   0.25 * across(camera.rotation.col(2), here.to_viewer) + 0.35 * sideways(baseline, here.to_viewer) +
                   0.5 * fill(interest, here.to_viewer, slope) - 0.003 * std::abs(elevation - 45);
      if (here.score > best.score + 1e-9) best = here;
    }
  }
  return best;
}

}  // namespace

std::vector<Eigen::Vector3d> Interest::points() const {
  std::vector<Eigen::Vector3d> all = devices;
  all.insert(all.end(), corners.begin(), corners.end());
  for (const Spot& spot : spots) all.push_back(spot.point);
  return all;
}

Box Interest::box() const {
  Box box{Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()),
          Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity())};
  for (const Eigen::Vector3d& point : points()) box.low = box.low.cwiseMin(point), box.high = box.high.cwiseMax(point);
  return box;
}

std::vector<size_t> some_views(size_t count, size_t most) {
  std::vector<size_t> views;
  const size_t kept = std::min(count, most);
  for (size_t i = 0; i < kept; ++i) views.push_back(kept == 1 ? 0 : i * (count - 1) / (kept - 1));
  return views;
}

Pose world_from_camera(const Scene& scene, size_t view) {
  return scene.trajectory[view].world_from_robot * scene.rig.robot_from_camera;
}

Pose world_from_projector(const Scene& scene, size_t view) {
  return world_from_camera(scene, view) * scene.rig.projector_from_camera.inverse();
}

std::vector<Eigen::Vector3d> image_corners(const Pinhole& device, double depth_m) {
  std::vector<Eigen::Vector3d> corners;
  const double right = device.width - 0.5, low = device.height - 0.5;
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(-0.5, -0.5), Eigen::Vector2d(right, -0.5),
                                       Eigen::Vector2d(right, low), Eigen::Vector2d(-0.5, low)}) {
    Eigen::Vector2d ray = device.undistort(pixel);
    // Ignore distortion where it has no inverse.
    if (!ray.allFinite()) ray = {(pixel.x() - device.cx) / device.fx, (pixel.y() - device.cy) / device.fy};
    corners.push_back(depth_m * Eigen::Vector3d(ray.homogeneous()));
  }
  return corners;
}

Interest interest_of(const Scene& scene, const RayScene& world) {
  constexpr size_t kMostViews = 16, kMostDevices = 64;
  constexpr int kPerSide = 9;
  Interest interest;
  for (const size_t view : some_views(scene.trajectory.size(), kMostDevices)) {
    interest.devices.push_back(world_from_camera(scene, view).translation);
  }
  interest.devices.push_back(world_from_projector(scene, 0).translation);
  const double out_of_range_m = 1.3 * scene.rig.far_m;
  add_corners(world, scene.rig.camera, world_from_camera(scene, 0), out_of_range_m, interest);
  add_corners(world, scene.rig.projector, world_from_projector(scene, 0), out_of_range_m, interest);
  for (const double farthest_m : {out_of_range_m, std::numeric_limits<double>::infinity()}) {
    for (const size_t view : some_views(scene.trajectory.size(), kMostViews))
      add_spots(scene, world, view, kPerSide, farthest_m, interest);
    if (!interest.spots.empty()) return interest;
  }
  // No surface is seen: use the far corners of the first view's frustum.
  const Pose pose = world_from_camera(scene, 0);
  for (const Eigen::Vector3d& corner : image_corners(scene.rig.camera, scene.rig.far_m))
    interest.spots.push_back({pose * corner, -pose.rotation.col(2)});
  return interest;
}

Viewpoint choose_viewpoint(const Scene& scene, const RayScene& world, const Interest& interest, int width, int height) {
  constexpr double kMargin = 0.88, kHalfHeight = 0.27;  // tangent of half the angle of view
  Box window = interest.box();
  const Eigen::Vector3d padding = Eigen::Vector3d::Constant(0.02 * (window.high - window.low).norm() + 1e-6);
  window.low -= padding, window.high += padding;
  const Eigen::Vector2d slope(kHalfHeight * width / height, kHalfHeight);
  Candidate best = best_direction(scene, interest, CutawayScene(scene, world), kMargin * slope);
  Viewpoint view;
  view.interest_m = (window.high - window.low).norm();
  if (best.sight.spots < 0.6 || best.sight.devices < 0.6) {
    const Candidate opened = best_direction(scene, interest, CutawayScene(scene, world, window), kMargin * slope);
    if (opened.score > best.score + 0.1) {
      best = opened;
      view.window = window;
    }
  }
  if (best.to_viewer.z() < 0) view.up = -Eigen::Vector3d::UnitZ();
  const double f = 0.5 * height / kHalfHeight;
  view.camera = {width, height, f, f, 0.5 * (width - 1), 0.5 * (height - 1), {}};
  view.world_from_camera.rotation = world_from_view(best.to_viewer);
  std::vector<Eigen::Vector3d> turned;
  for (const Eigen::Vector3d& point : interest.points())
    turned.push_back(view.world_from_camera.rotation.transpose() * point);
  view.world_from_camera.translation = view.world_from_camera.rotation * nearest_place(turned, kMargin * slope);
  return view;
}

}  // namespace fringeslam::sim
