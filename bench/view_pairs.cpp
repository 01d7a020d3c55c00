// SPDX-License-Identifier: Apache-2.0
#include "bench/view_pairs.h"

#include <utility>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

sim::Scene scene_of(const std::string& name, uint64_t seed) {
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", {seed});
}

// Views from the first poses of the trajectory.
Views views_of(const sim::Scene& scene, size_t count) {
  Views result{scene.rig, pixel_rays(scene.rig.camera), std::vector<View>(count)};
  sim::VirtualRig rig(scene, {});
  const DepthOptions depth;
  const Triangulation triangulation(scene.rig, result.rays, depth.near_m, depth.far_m);
  for (View& view : result.views) {
    const auto simulated = rig.simulate(scene.patterns);
    view.frame = reconstruct(decode(simulated->stack, scene.rig, {}), scene.rig, triangulation, depth);
    view.truth = simulated->truth;
  }
  return result;
}

}  // namespace

Views rendered_views(const std::string& scene_name, uint64_t seed, const std::vector<Pose>& world_from_camera) {
  return rendered_views(scene_of(scene_name, seed), world_from_camera);
}

Views rendered_views(sim::Scene scene, const std::vector<Pose>& world_from_camera) {
  const Pose camera_from_robot = scene.rig.robot_from_camera.inverse();
  scene.trajectory.clear();
  for (const Pose& pose : world_from_camera)
    scene.trajectory.push_back({static_cast<double>(scene.trajectory.size()), pose * camera_from_robot});
  return views_of(scene, world_from_camera.size());
}

ViewPair rendered_pair(const std::string& scene_name, uint64_t seed, const std::optional<Pose>& first_from_second) {
  sim::Scene scene = scene_of(scene_name, seed);
  if (first_from_second) {
    const Pose& mount = scene.rig.robot_from_camera;
    scene.trajectory.resize(1);
    scene.trajectory.push_back(scene.trajectory[0]);
    scene.trajectory[1].timestamp_s += 1;
    scene.trajectory[1].world_from_robot =
        scene.trajectory[0].world_from_robot * mount * *first_from_second * mount.inverse();
  }
  return views_of(scene, 2);
}

}  // namespace fringeslam::bench
