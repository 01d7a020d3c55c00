// SPDX-License-Identifier: Apache-2.0
#include "bench/landmark_pairs.h"

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

LandmarkPair rendered_pair(const std::string& scene_name, uint64_t seed) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + scene_name + "/scene.yaml", {seed});
  std::vector<TruthFrame> truth;
  sim::VirtualRig rig(scene, {}, [&](const TruthFrame& frame) { truth.push_back(frame); });
  LandmarkPair pair{scene.rig, pixel_rays(scene.rig.camera), {}};
  const DepthOptions depth;
  const Triangulation triangulation(scene.rig, pair.rays, depth.near_m, depth.far_m);
  for (LandmarkView& view : pair.views) {
    const auto stack = rig.capture(scene.patterns);
    view.frame = reconstruct(decode(*stack, scene.patterns, scene.rig, {}), scene.rig, triangulation, depth);
    view.truth = truth.back();
  }
  return pair;
}

Landmarks landmarks_of(const LandmarkPair& pair, const LandmarkView& view, const LandmarkMethod& method) {
  return identify_landmarks(view.frame, detect_keypoints(view.frame, pair.rig, pair.rays, method.keypoints), pair.rig,
                            method.keypoints, method.conditioning, method.clusters, method.landmarks);
}

}  // namespace fringeslam::bench
