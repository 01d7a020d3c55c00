// SPDX-License-Identifier: Apache-2.0
#include "tools/map_truth.h"

#include <algorithm>
#include <limits>

#include "core/io/tum_file.h"
#include "core/io/yaml.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/score/trajectory_file.h"
#include "sim/virtual_rig.h"
#include "tools/bag/bag_dataset.h"
#include "tools/euroc.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/tum_rgbd.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

bool path_exists(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

// Number of stacks of a dataset or run, whose scene may have more views; empty for a scene.
std::optional<int> stacks_of(const fs::path& folder) {
  if (path_exists(folder / kSceneFile)) return std::nullopt;
  if (path_exists(folder / kDatasetFile)) return read_dataset_info(folder).stacks;
  const fs::path config = folder / "config.yaml";
  if (path_exists(config)) return YamlMap::load(config).integer("stacks", {1, 1e6});
  return std::nullopt;
}

// Loads the scene from which a folder was rendered. The folder's rig.yaml is the calibration given to the pipeline, which
// may be wrong. It only serves to determine whether texture and depth images lack the scene's lens distortion, which fringe images never
// do.
sim::Scene scene_of_images(const fs::path& folder) {
  sim::Scene scene;
  try {
    scene = sim::load_scene(folder / kResolvedFile);
  } catch (const Error& error) {
    throw Error(std::string(error.what()) + "; give the scene itself as --truth");
  }
  const fs::path rig = folder / "rig.yaml";
  if (!stacks_of(folder) && path_exists(rig) && read_rig(rig).camera.distortion.is_zero())
    scene.rig.camera.distortion = {};
  return scene;
}

sim::Scene read_scene(const fs::path& path, std::optional<uint64_t> seed) {
  if (!path_exists(scene_file(path)) && !path_exists(path))
    throw Error(path.string() + ": does not exist; give a scene, a dataset or a run as --truth");
  if (!fs::is_directory(path) || path_exists(path / kSceneFile)) return sim::load_scene(scene_file(path), {seed});
  if (!path_exists(path / kResolvedFile))
    throw Error(path.string() + ": contains neither " + kSceneFile + " nor " + kResolvedFile +
                ", so its true surface is unknown");
  if (seed) throw Error(path.string() + ": --seed has no effect on a rendered folder; leave it out");
  return scene_of_images(path);
}

// The true trajectory of the camera in a folder in the layout of TUM RGB-D or EuRoC.
std::optional<fs::path> camera_truth_file(const fs::path& path) {
  for (const char* file : {kTumTruthFile, kEurocTruthFile}) {
    if (path_exists(path / file)) return path / file;
  }
  return std::nullopt;
}

}  // namespace

MapTruth read_map_truth(const fs::path& path, std::optional<uint64_t> seed, const Common& common) {
  sim::Scene scene = read_scene(path, seed);
  Trajectory trajectory = scene.trajectory;
  if (const auto camera = camera_truth_file(path)) {
    trajectory = scene.trajectory = read_trajectory(*camera);
    const Pose camera_from_robot = scene.rig.robot_from_camera.inverse();
    for (TimedPose& pose : scene.trajectory) pose.world_from_robot = pose.world_from_robot * camera_from_robot;
  } else {
    // The views along a path follow the clock of the rig.
    const fs::path poses = path / "truth" / "truth.tum";
    if (scene.path && path_exists(poses)) trajectory = scene.trajectory = read_tum(poses);
    if (const auto stacks = stacks_of(path))
      scene.trajectory.resize(std::min(scene.trajectory.size(), static_cast<size_t>(*stacks)));
  }
  MapTruth truth{scene.name, sim::NearestSurface(scene), {}, std::move(trajectory)};
  const PixelRays rays = pixel_rays(scene.rig.camera);
  const sim::VirtualRig rig(scene, {});
  Progress progress("visible surface", static_cast<int>(scene.trajectory.size()), common.quiet || common.json);
  for (size_t pose = 0; pose < scene.trajectory.size(); ++pose) {
    append_visible_surface(rig.truth_of(pose), scene.rig, rays, truth.seen);
    progress.step();
  }
  if (truth.seen.empty()) throw Error(path.string() + ": the sensor does not see the surface");
  return truth;
}

MapScore score_map(const PlyMap& map, const MapTruth& truth, double threshold_m) {
  constexpr double kAnywhere = std::numeric_limits<double>::infinity();
  sim::Mesh mesh{map.vertices, map.triangles};
  // Represents each point as a triangle without area.
  if (mesh.triangles.empty()) {
    for (int i = 0; i < static_cast<int>(mesh.vertices.size()); ++i) mesh.triangles.emplace_back(i, i, i);
  }
  return fringeslam::score_map(truth.surface.distances_m(map.vertices, kAnywhere),
                               sim::NearestSurface(std::move(mesh)).distances_m(truth.seen, kAnywhere), threshold_m);
}

fs::path true_trajectory_file(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) return path;
  if (path_exists(path / "truth" / "truth.tum")) return path / "truth" / "truth.tum";
  if (const auto file = camera_truth_file(path)) return *file;
  throw Error(path.string() + ": contains neither truth/truth.tum nor " + kTumTruthFile + " nor " + kEurocTruthFile);
}

Trajectory true_trajectory(const fs::path& path) {
  return is_bag(path) ? true_camera_trajectory(path) : read_trajectory(true_trajectory_file(path));
}

}  // namespace fringeslam::tools
