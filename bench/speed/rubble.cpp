// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/rubble.h"

#include <algorithm>

namespace fringeslam::bench {

sim::Scene rubble(int subdivisions) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/boxes_and_foam/scene.yaml");
  const sim::Material stone = scene.objects.back().material;
  scene.objects.resize(1);
  for (int i = 0; i < 36; ++i) {
    sim::Object rock;
    rock.mesh = std::make_shared<const sim::Mesh>(
        sim::rock_mesh({0.07, 0.05 + 0.001 * i, 0.06}, subdivisions, 0.3, static_cast<uint32_t>(i)));
    rock.world_from_object =
        pose_from({{60.0 * (i % 6) - 150, 60.0 * (i / 6) - 150, 20.0 + (i % 5)}, {20.0 * i, 7.0 * i, 31.0 * i}});
    rock.material = stone;
    rock.texture_seed = static_cast<uint32_t>(i);
    scene.objects.push_back(std::move(rock));
  }
  return scene;
}

Stack::Stack(const sim::Scene& scene, int patterns, const sim::RenderOptions& options, bool truth)
    : scene_(scene), truth_(truth) {
  sequence_ = phase_shift_sequence(scene.rig.projector.width, scene.rig.projector.height, {16.5}, std::max(patterns, 3),
                                   Axis::columns, 8);
  sequence_.patterns.resize(static_cast<size_t>(patterns));
  scene_.trajectory.assign(1000, scene.trajectory.front());
  rig_ = std::make_unique<sim::VirtualRig>(scene_, options);
}

void Stack::operator()() {
  if (truth_)
    rig_->simulate(sequence_);
  else
    rig_->capture(sequence_);
}

}  // namespace fringeslam::bench
