// SPDX-License-Identifier: Apache-2.0
// Views one after the other, two at a time: while the pipeline registers one, another thread captures the next, decodes
// it and reconstructs its depth. The results are those of one at a time, whatever the threads' pace.
#pragma once

#include <future>
#include <optional>

#include "core/pipeline/pipeline.h"
#include "core/rig/rig.h"

namespace fringeslam {

class Conveyor {
 public:
  // Both have to outlive it, and the rig is its own until it ends.
  Conveyor(Rig& rig, Pipeline& pipeline) : rig_(rig), pipeline_(pipeline) {}
  // Waits for the view that is on its way.
  ~Conveyor() = default;
  Conveyor(const Conveyor&) = delete;
  Conveyor& operator=(const Conveyor&) = delete;

  struct View {
    FringeStack stack;
    FrameResult result;
  };
  // Empty when the rig has nothing more to see. Throws what rig and pipeline throw.
  std::optional<View> next();

 private:
  using Ahead = std::optional<SeenStack>;
  Ahead look(const PatternSequence& patterns) const;

  Rig& rig_;
  Pipeline& pipeline_;
  std::future<Ahead> ahead_;
};

}  // namespace fringeslam
