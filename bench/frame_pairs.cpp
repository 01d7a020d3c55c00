// SPDX-License-Identifier: Apache-2.0
#include "bench/frame_pairs.h"

#include <cmath>
#include <numbers>
#include <random>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

FramePair rendered_frames(const std::string& scene_name, uint64_t seed, const Pose& target_from_source) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + scene_name + "/scene.yaml", {seed});
  const Pose& mount = scene.rig.robot_from_camera;
  scene.trajectory.resize(1);
  scene.trajectory.push_back(scene.trajectory[0]);
  scene.trajectory[1].timestamp_s += 1;
  scene.trajectory[1].world_from_robot =
      scene.trajectory[0].world_from_robot * mount * target_from_source * mount.inverse();
  FramePair pair{scene.rig, pixel_rays(scene.rig.camera), {}, {}, {}, {}, target_from_source};
  TruthFrame truth;
  sim::VirtualRig rig(scene, {}, [&](const TruthFrame& frame) { truth = frame; });
  const DepthOptions depth;
  const Triangulation triangulation(scene.rig, pair.rays, depth.near_m, depth.far_m);
  for (const bool first : {true, false}) {
    const auto stack = rig.capture(scene.patterns);
    (first ? pair.target : pair.source) =
        reconstruct(decode(*stack, scene.patterns, scene.rig, {}), scene.rig, triangulation, depth);
    (first ? pair.target_truth : pair.source_truth) = truth;
  }
  return pair;
}

Pose random_motion(double degrees, double metres, double amid_m, uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto uniform = [&] { return 2 * static_cast<double>(random() >> 11) / 9007199254740992.0 - 1; };
  const auto direction = [&] {
    for (;;) {
      const double x = uniform(), y = uniform(), z = uniform(), square = x * x + y * y + z * z;
      if (square < 1 && square > 1e-4) return Eigen::Vector3d(Eigen::Vector3d(x, y, z) / std::sqrt(square));
    }
  };
  const Pose to_middle{Eigen::Matrix3d::Identity(), {0, 0, amid_m}};
  const Eigen::Vector3d axis = direction(), shift = direction();
  const Pose motion{rotation_exp(degrees * std::numbers::pi / 180 * axis), metres * shift};
  return to_middle * motion * to_middle.inverse();
}

}  // namespace fringeslam::bench
