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
LoopScene rendered_loop();

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
