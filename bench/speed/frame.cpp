// SPDX-License-Identifier: Apache-2.0
// A whole run from images that are in memory.
#include <cstdio>

#include "bench/row.h"
#include "bench/speed/turns.h"
#include "core/pipeline/pipeline.h"
#include "core/score/score.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// From the last exposure of a view until its pose is known, and until the map has it.
struct Latencies {
  std::vector<double> pose_ms, map_ms;

  void add(const StageClock& clock, double view_s) {
    const auto& entered = clock.entered();
    const auto known = entered.find(entered.contains("map") ? "map" : "other");
    if (known == entered.end()) return;  // the view is lost
    pose_ms.push_back(1e3 * known->second);
    map_ms.push_back(1e3 * view_s);
  }
  std::vector<Row> rows() const {
    const int count = static_cast<int>(pose_ms.size());
    return {
        median_row("speed.latency.pose", pose_ms, "ms", 33),
        bound_row("speed.latency.pose_99", quantile_of(pose_ms, 0.99), count, "ms", 66, Limit::most),
        median_row("speed.latency.map", map_ms, "ms", 66),
        bound_row("speed.latency.map_99", quantile_of(map_ms, 0.99), count, "ms", 200, Limit::most),
    };
  }
};

std::vector<Row> frame_rows(const Context& context) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml");
  sim::VirtualRig rig(scene, {});
  std::vector<FringeStack> stacks;
  while (auto stack = rig.capture(scene.patterns)) stacks.push_back(std::move(*stack));

  std::vector<double> frames_per_s;
  Latencies latencies;
  for (int run = 0; run < (context.quick ? 1 : 3); ++run) {
    StageClock clock;
    Pipeline pipeline(scene.rig, scene.patterns, {}, scene.trajectory[0].world_from_robot);
    pipeline.time_stages(clock);
    const double seconds = seconds_of([&] {
      for (const FringeStack& stack : stacks) {
        clock.begin_view();
        const double view_s = seconds_of([&] { pipeline.process(stack); });
        latencies.add(clock, view_s);
      }
      clock.leave();
    });
    const auto count = static_cast<double>(stacks.size());
    frames_per_s.push_back(count / seconds);
    std::fprintf(stderr, "  %.1f ms a frame:", 1e3 * seconds / count);
    for (const auto& [stage, time] : clock.seconds())
      std::fprintf(stderr, " %s %.2f (%.0f %%)", stage.c_str(), 1e3 * time / count, 100 * time / seconds);
    std::fprintf(stderr, "\n");
  }
  std::vector<Row> rows = latencies.rows();
  rows.insert(rows.begin(), median_row("speed.frame", frames_per_s, "frames/s", 30, Limit::least));
  return rows;
}

}  // namespace

std::vector<Item> frame_speed_items() {
  return {{{"speed.frame", "speed.latency.pose", "speed.latency.pose_99", "speed.latency.map", "speed.latency.map_99"},
           "once around over a field of rubble, from images in memory to the map",
           frame_rows}};
}

}  // namespace fringeslam::bench
