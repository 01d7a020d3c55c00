// SPDX-License-Identifier: Apache-2.0
#include "bench/view_pairs.h"

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

ViewPair rendered_pair(const std::string& scene_name, uint64_t seed, const std::optional<Pose>& first_from_second) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + scene_name + "/scene.yaml", {seed});
  if (first_from_second) {
    const Pose& mount = scene.rig.robot_from_camera;
    scene.trajectory.resize(1);
    scene.trajectory.push_back(scene.trajectory[0]);
    scene.trajectory[1].timestamp_s += 1;
    scene.trajectory[1].world_from_robot =
        scene.trajectory[0].world_from_robot * mount * *first_from_second * mount.inverse();
  }
  ViewPair pair{scene.rig, pixel_rays(scene.rig.camera), {}};
  TruthFrame truth;
  sim::VirtualRig rig(scene, {}, [&](const TruthFrame& frame) { truth = frame; });
  const DepthOptions depth;
  const Triangulation triangulation(scene.rig, pair.rays, depth.near_m, depth.far_m);
  for (View& view : pair.views) {
    const auto stack = rig.capture(scene.patterns);
    view.frame = reconstruct(decode(*stack, scene.patterns, scene.rig, {}), scene.rig, triangulation, depth);
    view.truth = truth;
  }
  return pair;
}

}  // namespace fringeslam::bench
