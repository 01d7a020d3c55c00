// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/loop_rig.h"

#include <string>

#include "sim/virtual_rig.h"

namespace fringeslam::bench {

LoopScene rendered_loop() {
  LoopScene loop{sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml"), {}};
  sim::VirtualRig rig(loop.scene, {});
  while (auto stack = rig.capture(loop.scene.patterns)) loop.stacks.push_back(std::move(*stack));
  return loop;
}

std::optional<FringeStack> LoopRig::capture(const PatternSequence&) {
  const size_t views = loop_.stacks.size(), lap = next_ / views;
  if (lap == static_cast<size_t>(laps_)) return std::nullopt;
  FringeStack stack = loop_.stacks[next_ % views];  // shares the images
  const double step_s = loop_.stacks[1].timestamp_s - loop_.stacks[0].timestamp_s;
  const double lap_s = loop_.stacks.back().timestamp_s - loop_.stacks.front().timestamp_s + step_s;
  stack.index = static_cast<int>(next_);
  stack.timestamp_s += static_cast<double>(lap) * lap_s;
  ++next_;
  return stack;
}

}  // namespace fringeslam::bench
