// SPDX-License-Identifier: Apache-2.0
// Hours of mapping: repeated laps over the same rubble. The map is complete after the first lap, so that nothing may
// grow or slow down afterwards, and no wrong frame may ever be added.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <numbers>

#include "bench/process_memory.h"
#include "bench/row.h"
#include "bench/speed/loop_rig.h"
#include "core/mapper/driver.h"
#include "core/score/score.h"

namespace fringeslam::bench {

namespace {

constexpr int kWarmUp = 2;  // laps until memory reaches its steady state
constexpr double kWrong_m = 1e-3, kWrong_rad = 0.1 * std::numbers::pi / 180;

bool wrong(const Pose& found, const Pose& truth) {
  const Pose error = truth.inverse() * found;
  return translation_m(error) > kWrong_m || rotation_log(error.rotation).norm() > kWrong_rad;
}

struct Lap {
  double cpu_s = 0, memory_mib = 0;
};

struct Soak {
  std::vector<Lap> laps;
  int views = 0, lost = 0, wrong_views = 0, wrong_in_map = 0;
  double wall_s = 0;
};

int wrong_frames(const KeyframeMap& map, const LoopScene& loop) {
  return static_cast<int>(std::count_if(map.frames().begin(), map.frames().end(), [&](const MapFrame& frame) {
    const size_t pose = static_cast<size_t>(frame.frame.index) % loop.stacks.size();
    return wrong(map.world_from_camera(frame) * loop.scene.rig.robot_from_camera.inverse(),
                 loop.scene.trajectory[pose].world_from_robot);
  }));
}

Soak soaked(double duration_s) {
  const LoopScene loop = rendered_loop();
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed_s = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  LoopRig rig(loop, 1 << 20);
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  Driver driver(rig, pipeline);
  Soak soak;
  while (elapsed_s() < duration_s || soak.laps.size() < kWarmUp + 2) {
    const std::clock_t before = std::clock();
    for (const TimedPose& truth : loop.scene.trajectory) {
      const FrameResult result = driver.next()->result;
      ++soak.views;
      if (!has_pose(result.tracking))
        ++soak.lost;
      else
        soak.wrong_views += wrong(result.world_from_robot, truth.world_from_robot);
    }
    soak.laps.push_back({static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC, process_memory_mib("VmRSS")});
    std::fprintf(stderr,
                 "  lap %zu after %.0f s: %.1f ms of processor time per view, %.1f MiB; %zu keyframes, %zu frames in "
                 "the map; %d lost, %d wrong\n",
                 soak.laps.size(), elapsed_s(), 1e3 * soak.laps.back().cpu_s / static_cast<double>(loop.stacks.size()),
                 soak.laps.back().memory_mib, pipeline.map().keyframes().size(), pipeline.map().frames().size(),
                 soak.lost, soak.wrong_views);
  }
  soak.wall_s = elapsed_s();
  soak.wrong_in_map = wrong_frames(pipeline.map(), loop);
  return soak;
}

// Processor time depends less on other load than wall-clock time.
std::vector<Row> soak_rows(const Context& context) {
  const Soak soak = soaked(context.quick ? 120 : 3600);
  std::vector<double> cpu_s;
  for (size_t i = kWarmUp; i < soak.laps.size(); ++i) cpu_s.push_back(soak.laps[i].cpu_s);
  const auto half = cpu_s.begin() + static_cast<std::ptrdiff_t>(cpu_s.size() / 2);
  const double rate = median_of({cpu_s.begin(), half}) / median_of({half, cpu_s.end()});
  std::fprintf(stderr, "  %d views in %.0f s, %d lost\n", soak.views, soak.wall_s, soak.lost);
  const int laps = static_cast<int>(soak.laps.size());
  return {bound_row("soak.memory", soak.laps.back().memory_mib / soak.laps[kWarmUp].memory_mib, laps, "x", 1.03,
                    Limit::most),
          bound_row("soak.rate", rate, laps, "x", 0.95, Limit::least),
          bound_row("soak.wrong", soak.wrong_views + soak.wrong_in_map, soak.views, "", 0, Limit::most)};
}

}  // namespace

std::vector<Item> soak_items() {
  return {{{"soak.memory", "soak.rate", "soak.wrong"},
           "an hour over the same rubble: growth of memory, change of rate, wrong views and frames",
           soak_rows,
           true}};
}

}  // namespace fringeslam::bench
