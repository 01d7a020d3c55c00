// SPDX-License-Identifier: Apache-2.0
// A whole run from images that are in memory.
#include <cstdio>

#include "bench/row.h"
#include "bench/speed/turns.h"
#include "core/pipeline/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> frame_rows(const Context& context) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml");
  sim::VirtualRig rig(scene, {});
  std::vector<FringeStack> stacks;
  while (auto stack = rig.capture(scene.patterns)) stacks.push_back(std::move(*stack));

  std::vector<double> frames_per_s;
  for (int run = 0; run < (context.quick ? 1 : 3); ++run) {
    StageClock clock;
    Pipeline pipeline(scene.rig, scene.patterns, {}, scene.trajectory[0].world_from_robot);
    pipeline.time_stages(clock);
    const double seconds = seconds_of([&] {
      for (const FringeStack& stack : stacks) pipeline.process(stack);
      clock.leave();
    });
    const auto count = static_cast<double>(stacks.size());
    frames_per_s.push_back(count / seconds);
    std::fprintf(stderr, "  %.1f ms a frame:", 1e3 * seconds / count);
    for (const auto& [stage, time] : clock.seconds())
      std::fprintf(stderr, " %s %.2f (%.0f %%)", stage.c_str(), 1e3 * time / count, 100 * time / seconds);
    std::fprintf(stderr, "\n");
  }
  return {median_row("speed.frame", frames_per_s, "frames/s", 30, Limit::least)};
}

}  // namespace

std::vector<Item> frame_speed_items() {
  return {{{"speed.frame"}, "once around over a field of rubble, from images in memory to the map", frame_rows}};
}

}  // namespace fringeslam::bench
