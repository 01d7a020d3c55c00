// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/io/tum_file.h"
#include "sim/random.h"
#include "sim/scene/routes.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

// Generates camera views of a flat board in the plane z = 0 from z < 0: evenly spread distances, tilts in all
// directions, the board anywhere in the image. Returns robot poses.
Trajectory board_views(const YamlMap& map, const RigModel& rig, uint64_t seed, double interval_s, int most) {
  const int count = map.integer("count", {1, std::min(10000.0, static_cast<double>(most))});
  const std::vector<double> distance = map.numbers("distance_m", 2, kLength);
  const double tilt = map.number("max_tilt_deg", {0, 70}), roll = map.number_or("max_roll_deg", 20, {0, 180});
  const std::vector<double> extent = map.numbers("extent_m", 2, kLength);
  constexpr double kRadians = std::numbers::pi / 180;
  Philox random(seed, Stream::views, 0);
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    // A golden-ratio sequence spreads the distances evenly while consecutive views differ.
    const double z = distance[0] + (distance[1] - distance[0]) * (std::fmod(i * 0.618034, 1.0) + 0.5 / count);
    const double azimuth = 2 * std::numbers::pi * (i + random.uniform()) / count * 3;
    const double lean = tilt * kRadians * (0.35 + 0.65 * random.uniform());
    const Eigen::Vector3d axis(std::cos(azimuth), std::sin(azimuth), 0);
    Pose camera_from_board;
    camera_from_board.rotation =
        rotation_exp(lean * axis) * rotation_exp({0, 0, roll * kRadians * random.uniform(-1, 1)});
    // The board may lie anywhere in the image as long as all of it is visible.
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
            "a board of this size does not fit into the camera's view; reduce extent_m or increase distance_m");
    }
    trajectory.push_back({interval_s * i, camera_from_board.inverse() * rig.robot_from_camera.inverse()});
  }
  return trajectory;
}

constexpr double kRadian = std::numbers::pi / 180;
constexpr Range kAngle{-36000, 36000};

// Reads a robot pose, given directly or by camera position and target: {camera_m, look_at_m}.
Pose read_robot_pose(const YamlMap& map, const RigModel& rig) {
  if (!map.has("camera_m") && !map.has("look_at_m")) return map.as_pose();
  for (const char* key : {"translation_m", "rotation_deg", "rotation_matrix"}) {
    if (map.has(key)) throw map.error(key, std::string("give camera_m and look_at_m, or a pose by ") + key);
  }
  const Eigen::Vector3d eye = map.vector3("camera_m", {-1e4, 1e4}), target = map.vector3("look_at_m", {-1e4, 1e4});
  if ((target - eye).norm() < 1e-6) throw map.error("look_at_m", "the camera position coincides with its target");
  return looking_at(eye, target) * rig.robot_from_camera.inverse();
}

// Reads motions in the papers' six-number form, each `previous_from_current` of the robot.
std::vector<Pose> stage_motions(const YamlMap& map, const Pose& start, size_t most) {
  std::vector<Pose> route = {start};
  const std::vector<YamlMap> entries = map.maps("motions");
  if (entries.size() >= most)
    throw map.error("motions", "'motions' must list fewer than " + std::to_string(most) + " motions");
  for (const YamlMap& entry : entries) {
    SixDof motion;
    motion.translation_mm = entry.vector3("translation_mm", kMillimetres);
    motion.angles_deg = entry.vector3("rotation_deg", {-180, 180});
    route.push_back(route.back() * pose_from(motion));
  }
  return route;
}

std::vector<Pose> listed_poses(const YamlMap& map, const std::string& key, const RigModel& rig, size_t least,
                               size_t most) {
  std::vector<Pose> poses;
  const std::vector<YamlMap> entries = map.maps(key);
  if (entries.size() > most) throw map.error(key, "'" + key + "' must list at most " + std::to_string(most) + " poses");
  for (const YamlMap& entry : entries) {
    entry.attempt([&] { poses.push_back(read_robot_pose(entry, rig)); });
  }
  if (poses.size() < least)
    throw map.error(key,
                    "'" + key + "' must list at least " + std::to_string(least) + (least == 1 ? " pose" : " poses"));
  return poses;
}

struct Spline {
  std::vector<Pose> waypoints;
  int count = 0;
  bool closed = false;
  double turn_m_per_rad = 0.5;
};

// `continuous`: the number of views is not needed.
Spline read_spline(const YamlMap& map, const RigModel& rig, Range counts, bool continuous) {
  constexpr size_t kMostWaypoints = 10000;  // each expands to 64 poses while the curve is measured
  Spline spline;
  spline.waypoints = listed_poses(map, "waypoints", rig, 2, kMostWaypoints);
  spline.count = continuous && !map.has("count") ? 2 : map.integer("count", counts);
  spline.closed = map.boolean_or("closed", false);
  spline.turn_m_per_rad = map.number_or("turn_m_per_rad", spline.turn_m_per_rad, {0, 100});
  return spline;
}

// Returns a tour of the building as a spline. The number of views follows from `step_m` unless `count` is given.
Spline read_tour(const YamlMap& map, const std::optional<BuildingPlan>& building, const RigModel& rig, uint64_t seed,
                 Range counts) {
  if (!building) throw map.error("a tour needs a building; add the section 'building'");
  Tour tour;
  tour.height = map.number_or("height_m", tour.height, {0.1, 2});
  tour.ahead = map.number_or("ahead_m", tour.ahead, {0.05, 5});
  tour.laps = map.integer_or("laps", tour.laps, {1, 1000});
  const double step = map.number_or("step_m", 0.1, {1e-3, 10});
  Spline spline;
  for (const Pose& world_from_camera : tour_waypoints(*building, tour, seed))
    spline.waypoints.push_back(world_from_camera * rig.robot_from_camera.inverse());
  double length = 0;
  for (size_t i = 1; i < spline.waypoints.size(); ++i) {
    const Pose motion = spline.waypoints[i - 1].inverse() * spline.waypoints[i];
    length += translation_m(motion) + spline.turn_m_per_rad * rotation_rad(motion);
  }
  const double views = std::ceil(length / step);
  if (views > counts.high)
    throw map.error("step_m", range_error("views of the tour", views, counts) + "; increase step_m or reduce laps");
  spline.count = std::max(2, static_cast<int>(views));
  return spline;
}

std::vector<Pose> read_orbit(const YamlMap& map, const RigModel& rig, Range counts) {
  Orbit orbit;
  orbit.centre = map.vector3("centre_m", {-1e4, 1e4});
  orbit.radius = map.number("radius_m", kLength);
  orbit.height = map.number("height_m", {-100, 100});
  orbit.from = kRadian * map.number_or("from_deg", 0, kAngle);
  orbit.to = kRadian * map.number_or("to_deg", 360, kAngle);
  orbit.count = map.integer("count", counts);
  std::vector<Pose> route;
  for (const Pose& world_from_camera : orbit_route(orbit))
    route.push_back(world_from_camera * rig.robot_from_camera.inverse());
  return route;
}

std::vector<Pose> read_random_walk(const YamlMap& map, const Pose& start, uint64_t seed, Range counts) {
  RandomWalk walk;
  walk.start = start;
  walk.count = map.integer("count", counts);
  walk.step = 1e-3 * map.vector3("step_mm", {0, 1e4});
  walk.turn = kRadian * map.vector3_or("turn_deg", Eigen::Vector3d::Zero(), {0, 90});
  walk.max_turn = kRadian * map.number_or("max_turn_deg", 20, {0, 170});
  const std::vector<double> low = map.numbers("low_m", 3, {-1e4, 1e4}), high = map.numbers("high_m", 3, {-1e4, 1e4});
  for (int i = 0; i < 3; ++i) {
    walk.low[i] = low[static_cast<size_t>(i)];
    walk.high[i] = high[static_cast<size_t>(i)];
    const double here = start.translation[i];
    if (!(walk.low[i] <= here && here <= walk.high[i]))
      throw map.error("low_m", std::string("the walk must start between low_m and high_m, but its ") + "xyz"[i] +
                                   " is " + to_text(here));
  }
  return random_walk(walk, seed);
}

Trajectory read_file(const YamlMap& map) {
  const std::filesystem::path file = map.file("file");
  const Trajectory trajectory = read_tum(file);
  if (trajectory.empty()) throw map.error("file", file.string() + " contains no pose");
  return trajectory;
}

Motion read_motion(const YamlMap& map) {
  Motion motion;
  motion.velocity_m_s = 1e-3 * map.vector3_or("velocity_mm_s", Eigen::Vector3d::Zero(), kMillimetres);
  motion.angular_rad_s = kRadian * map.vector3_or("rotation_deg_s", Eigen::Vector3d::Zero(), {-3600, 3600});
  return motion;
}

Travel read_travel(const YamlMap& map) {
  Travel travel;
  travel.speed_m_s = map.number("speed_m_s", {1e-4, 100});
  travel.max_rad_s = kRadian * map.number_or("max_deg_s", 60, {1e-2, 3600});
  travel.acceleration_m_s2 = map.number_or("acceleration_m_s2", travel.acceleration_m_s2, {1e-3, 1e3});
  travel.from_rest = map.boolean_or("from_rest", false);
  if (map.has("stop_and_go")) {
    const YamlMap stops = map.map("stop_and_go");
    travel.move_s = stops.number("move_s", {1e-2, 1e4});
    travel.stop_s = stops.number("stop_s", {1e-2, 1e4});
  }
  return travel;
}

Vibration read_vibration(const YamlMap& map) {
  Vibration vibration;
  vibration.amplitude_m = 1e-3 * map.number_or("amplitude_mm", 0, {0, 1e3});
  vibration.amplitude_rad = kRadian * map.number_or("amplitude_deg", 0, {0, 45});
  const std::vector<double> band = map.numbers("band_hz", 2, {1e-2, 1e4});
  if (band[0] > band[1]) throw map.error("band_hz", "'band_hz' must be [low, high]");
  vibration.low_hz = band[0];
  vibration.high_hz = band[1];
  return vibration;
}

// Returns a list of different poses as a densely sampled smooth curve.
std::vector<Pose> smooth_route(const YamlMap& map, const std::vector<Pose>& poses, bool closed, double turn_m_per_rad) {
  std::vector<Pose> waypoints;
  for (const Pose& pose : poses) {
    const Pose step = waypoints.empty() ? Pose{} : waypoints.back().inverse() * pose;
    if (waypoints.empty() || translation_m(step) > 1e-9 || rotation_rad(step) > 1e-9) waypoints.push_back(pose);
  }
  if (waypoints.size() < 2)
    throw map.error("continuous", "continuous motion needs a route of at least two different poses");
  constexpr int kPerWaypoint = 100;
  return sample_spline(waypoints, kPerWaypoint * static_cast<int>(waypoints.size()), closed, turn_m_per_rad);
}

// Samples the path for previews and time-less uses of the trajectory.
Trajectory sampled(const ContinuousPath& path, double interval_s, size_t most) {
  Trajectory trajectory;
  for (double time_s = 0; time_s <= path.duration_s() && trajectory.size() < most; time_s += interval_s)
    trajectory.push_back({time_s, path.at(time_s)});
  return trajectory;
}

}  // namespace

void read_trajectory(const YamlMap& map, const SceneLimits& limits, const std::optional<BuildingPlan>& building,
                     Scene& scene) {
  const RigModel& rig = scene.rig;
  const std::vector<std::string> kinds = {"motions", "poses",       "spline", "tour",
                                          "orbit",   "random_walk", "file",   "board_views"};
  std::vector<std::string> given;
  for (const std::string& kind : kinds) {
    if (map.has(kind)) given.push_back(kind);
  }
  if (given.size() > 1) throw map.error(given[1], "give " + given[0] + " or " + given[1] + ", not both");
  const std::string kind = given.empty() ? "" : given[0];
  const double interval = map.number_or("interval_s", 0.5, {1e-3, 1e4});
  if (map.has("while_capturing")) scene.motion = read_motion(map.map("while_capturing"));
  const bool continuous = map.has("continuous");
  if (continuous && map.has("while_capturing"))
    throw map.error("while_capturing", "give continuous or while_capturing, not both");
  if (continuous && kind == "board_views")
    throw map.error("continuous",
                    "'continuous' has no effect with board_views, which are unconnected; remove one of them");
  if (continuous && scene.commanded)
    throw map.error("commanded", "'commanded' has no effect with continuous: no poses are commanded; remove it");
  if (!continuous && kind == "file" && map.has("interval_s"))
    throw map.error("interval_s", "'interval_s' has no effect with file, whose poses have times; remove it");
  std::optional<Spline> spline;
  const auto views = [&] {
    if (kind == "board_views") return board_views(map.map(kind), rig, scene.seed, interval, limits.views);
    if (kind == "file") return read_file(map);
    const bool starts = kind.empty() || kind == "motions" || kind == "random_walk";
    if (map.has("start") && !starts) throw map.error("start", "'start' has no effect with " + kind);
    const Pose start = starts && map.has("start") ? read_robot_pose(map.map("start"), rig) : Pose{};
    const Range counts{1, static_cast<double>(limits.views)};
    const auto most = static_cast<size_t>(limits.views);
    if (kind == "spline") spline = read_spline(map.map(kind), rig, counts, continuous);
    if (kind == "tour") spline = read_tour(map.map(kind), building, rig, scene.seed, counts);
    const std::vector<Pose> route =
        kind == "motions" ? stage_motions(map, start, most)
        : kind == "poses" ? listed_poses(map, kind, rig, 1, most)
        : spline          ? sample_spline(spline->waypoints, spline->count, spline->closed, spline->turn_m_per_rad)
        : kind == "orbit" ? read_orbit(map.map(kind), rig, counts)
        : kind == "random_walk" ? read_random_walk(map.map(kind), start, scene.seed, counts)
                                : std::vector<Pose>{start};
    Trajectory trajectory;
    for (const Pose& pose : route)
      trajectory.push_back({interval * static_cast<double>(trajectory.size()), orthonormalised(pose)});
    return trajectory;
  };
  scene.trajectory = views();
  if (!continuous) return;

  constexpr double kKnot_s = 0.05;
  const YamlMap motion = map.map("continuous");
  scene.view_rate_hz = motion.number_or("view_rate_hz", 0, {0, 1e5});
  const Vibration vibration = motion.has("vibration") ? read_vibration(motion.map("vibration")) : Vibration{};
  const auto reported = [&](const auto& controls) {
    try {
      return controls();
    } catch (const Error& e) {
      throw map.error("continuous", e.what());
    }
  };
  const auto controls_of = [&] {
    if (kind == "file" && !motion.has("speed_m_s"))
      return reported([&] { return resampled(scene.trajectory, kKnot_s); });
    std::vector<Pose> poses;
    if (spline) {
      poses = smooth_route(map, spline->waypoints, spline->closed, spline->turn_m_per_rad);
    } else {
      for (const TimedPose& pose : scene.trajectory) poses.push_back(pose.world_from_robot);
      poses = smooth_route(map, poses, false, 0.5);
    }
    const Travel travel = read_travel(motion);
    return reported([&] { return travelled(poses, travel, kKnot_s); });
  };
  std::vector<Pose> controls = controls_of();
  scene.path.emplace(std::move(controls), kKnot_s, vibration, scene.seed);
  scene.trajectory = sampled(*scene.path, interval, static_cast<size_t>(limits.views));
}

}  // namespace fringeslam::sim
