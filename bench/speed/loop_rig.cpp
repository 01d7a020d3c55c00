// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/loop_rig.h"

#include <limits>
#include <string>
#include <utility>

#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

sim::Scene loaded(const sim::SceneLoadOptions& reading) {
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml", reading);
}

LoopScene rendered(const sim::SceneLoadOptions& reading, size_t views) {
  LoopScene loop{loaded(reading), {}};
  sim::VirtualRig rig(loop.scene, {});
  while (loop.stacks.size() < views) {
    auto stack = rig.capture(loop.scene.patterns);
    if (!stack) break;
    loop.stacks.push_back(std::move(*stack));
  }
  return loop;
}

}  // namespace

LoopScene rendered_loop() { return rendered({}, std::numeric_limits<size_t>::max()); }

LoopScene rendered_loop_of_a_robot(int views) {
  sim::SceneLoadOptions reading;
  reading.changes = {{"trajectory.spline.count", std::to_string(kRobotViews)}, {"trajectory.interval_s", "0.0333333"}};
  return rendered(reading, static_cast<size_t>(views));
}

LoopScene rendered_loop_in_motion(int views) {
  sim::SceneLoadOptions reading;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
  LoopScene loop{loaded(reading), {}};
  sim::VirtualRig rig(loop.scene, {});
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  while (loop.stacks.size() < static_cast<size_t>(views)) {
    auto stack = rig.capture(pipeline.next_patterns());
    if (!stack) break;
    pipeline.process(*stack);
    loop.stacks.push_back(std::move(*stack));
  }
  return loop;
}

std::optional<FringeStack> LoopRig::capture(const PatternSequence&) {
  const size_t views = loop_.stacks.size(), lap = next_ / views;
  if (lap == static_cast<size_t>(laps_)) return std::nullopt;
  FringeStack stack = loop_.stacks[next_ % views];  // shares the image data
  const double step_s = loop_.stacks[1].timestamp_s - loop_.stacks[0].timestamp_s;
  const double lap_s = loop_.stacks.back().timestamp_s - loop_.stacks.front().timestamp_s + step_s;
  stack.index = static_cast<int>(next_);
  stack.timestamp_s += static_cast<double>(lap) * lap_s;
  for (double& time_s : stack.exposure_time_s) time_s += static_cast<double>(lap) * lap_s;
  ++next_;
  return stack;
}

}  // namespace fringeslam::bench
