// SPDX-License-Identifier: Apache-2.0
// A whole run from images in memory.
#include <cstdio>
#include <string>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "bench/speed/loop_rig.h"
#include "core/base/stage_clock.h"
#include "core/mapper/driver.h"
#include "core/score/score.h"

namespace fringeslam::bench {

namespace {

// Latency from a view's last exposure until its pose is known, and until it is in the map.
struct Latencies {
  std::vector<double> pose_ms, map_ms;

  void add(const StageClock& clock, double view_s) {
    const auto& entered = clock.entered();
    const auto known = entered.find(entered.contains("map") ? "map" : "other");
    if (known == entered.end()) return;  // tracking was lost
    pose_ms.push_back(1e3 * known->second);
    map_ms.push_back(1e3 * view_s);
  }
  std::vector<Row> rows(const std::string& id) const {
    const int count = static_cast<int>(pose_ms.size());
    return {
        median_row(id + ".pose", pose_ms, "ms", 33),
        bound_row(id + ".pose_99", quantile_of(pose_ms, 0.99), count, "ms", 66, Limit::most),
        median_row(id + ".map", map_ms, "ms", 66),
        bound_row(id + ".map_99", quantile_of(map_ms, 0.99), count, "ms", 200, Limit::most),
    };
  }
};

// Fuses the surface of all views with their final poses.
double frames_per_s(const LoopScene& loop) {
  LoopRig rig(loop, 1);
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  const double mapped_s = seconds_of([&] {
    Driver driver(rig, pipeline);
    while (driver.next()) {
    }
  });
  const double surface_s = seconds_of([&] { pipeline.surface(); });
  const auto views = static_cast<double>(loop.stacks.size());
  std::fprintf(stderr, "  %.1f frames/s into the map, and %.1f s for the surface of %zu of them\n", views / mapped_s,
               surface_s, pipeline.map().frames().size());
  return views / (mapped_s + surface_s);
}

// Processes one view at a time and prints each stage's share.
void time_stages(const LoopScene& loop, Latencies& latencies) {
  StageClock clock;
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  const StageClock::Use use(clock);
  const double seconds = seconds_of([&] {
    for (const FringeStack& stack : loop.stacks) {
      clock.begin_view();
      const double view_s = seconds_of([&] { pipeline.process(stack); });
      latencies.add(clock, view_s);
    }
    clock.leave();
  });
  const auto count = static_cast<double>(loop.stacks.size());
  std::fprintf(stderr, "  one at a time %.1f ms per frame:", 1e3 * seconds / count);
  for (const auto& [stage, time] : clock.seconds())
    std::fprintf(stderr, " %s %.2f (%.0f %%)", stage.c_str(), 1e3 * time / count, 100 * time / seconds);
  std::fprintf(stderr, "\n");
}

// Returns the frame rate of `runs` runs, interleaved with `timed` runs that measure latencies; `suffix`: of the rows'
// ids.
std::vector<Row> rows_of(const LoopScene& loop, const std::string& suffix, int timed, int runs) {
  Latencies latencies;
  std::vector<double> rates;
  for (int run = 0; run < runs; ++run) {
    if (run < timed) time_stages(loop, latencies);
    rates.push_back(frames_per_s(loop));
  }
  std::vector<Row> rows = latencies.rows("speed.latency" + suffix);
  rows.insert(rows.begin(), median_row("speed.frame" + suffix, rates, "frames/s", 30, Limit::least));
  return rows;
}

std::vector<Row> frame_rows(const Context& context) {
  const int runs = context.quick ? 1 : 3;
  return rows_of(rendered_loop(), "", runs, runs);
}

// Most of the robot's views show hardly anything new, and the map stores only those that do.
std::vector<Row> robot_rows(const Context& context) {
  return rows_of(rendered_loop_of_a_robot(context.quick ? kRobotViews / 4 : kRobotViews), ".robot", 1,
                 context.quick ? 1 : 3);
}

std::vector<Row> moving_rows(const Context& context) {
  return rows_of(rendered_loop_in_motion(context.quick ? kRobotViews / 4 : kRobotViews), ".moving", 1,
                 context.quick ? 1 : 3);
}

}  // namespace

std::vector<Item> frame_speed_items() {
  return {{{"speed.frame", "speed.latency.pose", "speed.latency.pose_99", "speed.latency.map", "speed.latency.map_99"},
           "one lap over a field of rubble, from images in memory to the map and its surface",
           frame_rows},
          {{"speed.frame.robot", "speed.latency.robot.pose", "speed.latency.robot.pose_99", "speed.latency.robot.map",
            "speed.latency.robot.map_99"},
           "the same path at 0.3 m/s, 30 views per second",
           robot_rows},
          {{"speed.frame.moving", "speed.latency.moving.pose", "speed.latency.moving.pose_99",
            "speed.latency.moving.map", "speed.latency.moving.map_99"},
           "the same path without stops at 0.3 m/s, three images per view at 90 images per second",
           moving_rows}};
}

}  // namespace fringeslam::bench
