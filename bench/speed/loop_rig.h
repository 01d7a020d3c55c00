// SPDX-License-Identifier: Apache-2.0
// The scene `loop` from memory: laps over a field of rubble, as many as needed.
#pragma once

#include <vector>

#include "core/rig/rig.h"
#include "sim/scene/scene.h"

namespace fringeslam::bench {

struct LoopScene {
  sim::Scene scene;
  std::vector<FringeStack> stacks;
};
// Renders the scene as defined: 7.5 cm between views.
LoopScene rendered_loop();
// Renders the first `views` views of a robot on the same path at 0.3 m/s and 30 views per second: 1 cm between views. A
// thousand views need 2.4 GB.
constexpr int kRobotViews = 901;  // one lap
LoopScene rendered_loop_of_a_robot(int views);
// Renders the first `views` views of a robot that does not stop: 0.3 m/s, 90 images per second, motion blur, and three
// images per view once the robot is tracked. The patterns depend on the pipeline, which maps the views meanwhile.
LoopScene rendered_loop_in_motion(int views);

// A rig that replays the stacks lap after lap, with increasing indices and timestamps.
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
