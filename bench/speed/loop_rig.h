// SPDX-License-Identifier: Apache-2.0
// The scene `loop` from memory: once around over a field of rubble and back, as often as wanted.
#pragma once

#include <vector>

#include "core/rig/rig.h"
#include "sim/scene/scene.h"

namespace fringeslam::bench {

struct LoopScene {
  sim::Scene scene;
  std::vector<FringeStack> stacks;
};
// As the scene has it: 7.5 cm from view to view.
LoopScene rendered_loop();
// The first `views` of those that a robot of 0.3 m/s takes on the same way, 30 a second: 1 cm from view to view. A
// thousand views need 2.4 GB.
constexpr int kRobotViews = 901;  // once around
LoopScene rendered_loop_of_a_robot(int views);

// Its stacks lap after lap, with indices and timestamps that go on.
class LoopRig : public Rig {
 public:
  LoopRig(const LoopScene& loop, int laps) : loop_(loop), laps_(laps) {}
  const RigModel& model() const override { return loop_.scene.rig; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

 private:
  const LoopScene& loop_;
  int laps_;
  size_t next_ = 0;
};

}  // namespace fringeslam::bench
