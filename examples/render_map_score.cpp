// SPDX-License-Identifier: Apache-2.0
// Renders a scene, maps it and scores the trajectory against ground truth: render_map_score SCENE.yaml
#include <fringeslam/fringeslam.h>

#include <cstdio>

using namespace fringeslam;

int main(int argc, char** argv) {
  const sim::Scene scene = sim::load_scene(argc > 1 ? argv[1] : "scenes/boxes_and_foam/scene.yaml");
  sim::VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, scene.trajectory.front().world_from_robot);

  Driver(rig, pipeline).run([](const MappedView& view) {
    std::printf("view %d: %s\n", view.stack.index, to_string(view.result.tracking).c_str());
  });

  const TrajectoryScore score = score_trajectory(pipeline.trajectory(), scene.trajectory);
  std::printf("%d poses, ATE %.4f mm\n", score.poses, 1e3 * score.ate_rmse_m);
  return score.ate_rmse_m < 1e-3 ? 0 : 1;
}
