// SPDX-License-Identifier: Apache-2.0
#include "sim/scene_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>

#include "sim/light/renderer.h"

namespace fringeslam::sim {

namespace {

constexpr double kLeastLit = 0.3, kLeastInRange = 0.3, kLeastOverlap = 0.3;

// Returns a point behind a surface that a ray hit, farther away than single precision of its coordinates resolves.
Eigen::Vector3d beyond(const Hit& hit, const Eigen::Vector3d& direction) {
  constexpr double kLeast_m = 1e-5, kPrecision = 4e-6, kGrazing = 0.05;
  const double across = std::max(kGrazing, std::abs(hit.normal.dot(direction)));
  return hit.point + std::max(kLeast_m, kPrecision * (1 + hit.point.norm())) / across * direction;
}

// Returns an object that contains the point: a ray from inside a closed surface crosses it an odd number of times.
std::optional<int> object_around(const RayScene& world, const Eigen::Vector3d& point) {
  std::map<int, int> crossings;
  const Eigen::Vector3d direction = Eigen::Vector3d(0.31, 0.17, 0.93).normalized();
  Eigen::Vector3d from = point;
  for (int i = 0; i < 1000; ++i) {
    const auto hit = world.trace(from, direction);
    if (!hit) break;
    ++crossings[hit->object];
    from = beyond(*hit, direction);
  }
  // An open sheet is also crossed once from one side: require an odd count in the opposite direction, too.
  for (const auto& [object, count] : crossings) {
    if (count % 2 == 0) continue;
    int behind = 0;
    from = point;
    for (int i = 0; i < 1000; ++i) {
      const auto hit = world.trace(from, -direction);
      if (!hit) break;
      behind += hit->object == object;
      from = beyond(*hit, -direction);
    }
    if (behind % 2 == 1) return object;
  }
  return std::nullopt;
}

// Share of one view's lit points that project into another view's image.
double overlap_with(const TruthFrame& before, const Pinhole& camera, const Pose& camera_from_world) {
  int lit = 0, seen = 0;
  const double largest_r2 = camera.largest_r2();
  for (int row = 0; row < before.mask.rows; row += 8) {
    for (int col = 0; col < before.mask.cols; col += 8) {
      const int mask = static_cast<int>(before.mask(row, col));
      if (!(mask & kTruthInBeam) || (mask & kTruthInShadow)) continue;
      ++lit;
      const cv::Vec3f p = before.position_m(row, col);
      const Eigen::Vector3d point = camera_from_world * Eigen::Vector3f(p[0], p[1], p[2]).cast<double>();
      Eigen::Vector2d pixel;
      seen += camera.shows(point, largest_r2, pixel);
    }
  }
  return lit == 0 ? 0 : static_cast<double>(seen) / lit;
}

void warn(SceneCheck& check, size_t view, const char* format, double share) {
  char text[256];
  std::snprintf(text, sizeof text, format, 100 * share);
  check.warnings.push_back("view " + std::to_string(view) + ": " + text);
}

}  // namespace

SceneCheck check_scene(const Scene& scene, const std::function<void()>& checked) {
  const Renderer renderer(scene, Effects::none(), 1);
  const RigModel& rig = scene.rig;
  const ProjectedPatterns nothing({rig.projector.width, rig.projector.height, {}}, rig, {});
  SceneCheck check;
  TruthFrame before;
  for (size_t i = 0; i < scene.trajectory.size(); ++i) {
    const Pose world_from_camera = scene.trajectory[i].world_from_robot * rig.robot_from_camera;
    TruthFrame truth;
    renderer.render(nothing, {world_from_camera}, static_cast<int>(i), &truth);
    ViewCheck view;
    const auto pixels = static_cast<double>(truth.mask.total());
    for (int k = 0; k < static_cast<int>(truth.mask.total()); ++k) {
      const int mask = static_cast<int>(truth.mask(k));
      const bool lit = (mask & kTruthInBeam) && !(mask & kTruthInShadow);
      const auto depth = static_cast<double>(truth.depth_m(k));
      view.surface += (mask & kTruthSurface ? 1 : 0) / pixels;
      view.lit += (lit ? 1 : 0) / pixels;
      view.in_range += (lit && depth >= rig.near_m && depth <= rig.far_m ? 1 : 0) / pixels;
    }
    view.overlap = i == 0 ? 1 : overlap_with(before, rig.camera, world_from_camera.inverse());
    if (const auto object = object_around(renderer.world(), world_from_camera.translation)) {
      view.inside = true;
      view.object = scene.objects[static_cast<size_t>(*object)].name;
      check.warnings.push_back("view " + std::to_string(i) + ": the camera is inside " + view.object);
    }
    if (view.lit < kLeastLit)
      warn(check, i, "only %.0f %% of the pixels see a surface lit by the projector", view.lit);
    else if (view.in_range < kLeastInRange)
      warn(check, i, "only %.0f %% of the pixels are lit and between near_m and far_m", view.in_range);
    if (view.overlap < kLeastOverlap)
      warn(check, i, "only %.0f %% of the previous view's lit points are in the image", view.overlap);
    check.views.push_back(view);
    before = std::move(truth);
    if (checked) checked();
  }
  return check;
}

}  // namespace fringeslam::sim
