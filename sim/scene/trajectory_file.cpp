// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "sim/random.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

// Camera poses that look at a flat board in the plane z = 0 from z < 0: distances spread evenly, tilts in all
// directions, the board anywhere in the image. Robot poses are returned.
Trajectory board_views(const YamlMap& map, const RigModel& rig, uint64_t seed, double interval_s) {
  const int count = map.integer("count", {1, 10000});
  const std::vector<double> distance = map.numbers("distance_m", 2, kLength);
  const double tilt = map.number("max_tilt_deg", {0, 70}), roll = map.number_or("max_roll_deg", 20, {0, 180});
  const std::vector<double> extent = map.numbers("extent_m", 2, kLength);
  constexpr double kRadians = std::numbers::pi / 180;
  Philox random(seed, Stream::views, 0);
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    // Neighbours in the list differ in everything; taken together each quantity is spread evenly.
    const double z = distance[0] + (distance[1] - distance[0]) * (std::fmod(i * 0.618034, 1.0) + 0.5 / count);
    const double azimuth = 2 * std::numbers::pi * (i + random.uniform()) / count * 3;
    const double lean = tilt * kRadians * (0.35 + 0.65 * random.uniform());
    const Eigen::Vector3d axis(std::cos(azimuth), std::sin(azimuth), 0);
    Pose camera_from_board;
    camera_from_board.rotation =
        rotation_exp(lean * axis) * rotation_exp({0, 0, roll * kRadians * random.uniform(-1, 1)});
    // Anywhere in the image, as long as the whole board is.
    const auto in_view = [&] {
      for (const double x : {-0.5, 0.5}) {
        for (const double y : {-0.5, 0.5}) {
          const Eigen::Vector3d corner = camera_from_board * Eigen::Vector3d(x * extent[0], y * extent[1], 0);
          if (!rig.camera.contains(rig.camera.project(corner))) return false;
        }
      }
      return true;
    };
    constexpr int kTries = 500;
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const Eigen::Vector2d pixel(rig.camera.width * random.uniform(), rig.camera.height * random.uniform());
      camera_from_board.translation = z * Eigen::Vector3d(rig.camera.undistort(pixel).homogeneous());
      if (in_view()) break;
      if (attempt + 1 == kTries)
        throw map.error(
            "extent_m",
            "a board of this size does not fit into the camera's view; make it smaller or distance_m larger");
    }
    trajectory.push_back({interval_s * i, camera_from_board.inverse() * rig.robot_from_camera.inverse()});
  }
  return trajectory;
}

}  // namespace

// Robot poses: a start, then the papers' six numbers for each motion, `previous_from_current`.
Trajectory read_trajectory(const YamlMap& map, const RigModel& rig, uint64_t seed) {
  const double interval = map.number_or("interval_s", 0.5, {1e-3, 1e4});
  if (map.has("board_views")) return board_views(map.map("board_views"), rig, seed, interval);
  Trajectory trajectory(1);
  if (map.has("start")) trajectory[0].world_from_robot = map.pose("start");
  if (!map.has("motions")) return trajectory;  // one view
  for (const YamlMap& entry : map.maps("motions")) {
    SixDof motion;
    motion.translation_mm = entry.vector3("translation_mm", kMillimetres);
    motion.angles_deg = entry.vector3("rotation_deg", {-180, 180});
    const TimedPose& last = trajectory.back();
    trajectory.push_back(
        {interval * static_cast<double>(trajectory.size()), last.world_from_robot * pose_from(motion)});
  }
  return trajectory;
}

}  // namespace fringeslam::sim
