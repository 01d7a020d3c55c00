// SPDX-License-Identifier: Apache-2.0
// Views one after the other, two at a time: while the pipeline registers one, another thread captures the next, decodes
// it and reconstructs its depth. The results are those of one at a time, whatever the threads' pace.
#pragma once

#include <condition_variable>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "core/pipeline/pipeline.h"
#include "core/rig/rig.h"

namespace fringeslam {

class Conveyor {
 public:
  // Both have to outlive it, and the rig is its own until it ends.
  Conveyor(Rig& rig, Pipeline& pipeline);
  // Waits for the view that is on its way.
  ~Conveyor();
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
  void ask(const PatternSequence& patterns);
  Ahead answer();
  void look_ahead();

  Rig& rig_;
  Pipeline& pipeline_;
  std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  std::optional<PatternSequence> asked_;
  std::optional<Ahead> answer_;
  std::exception_ptr failure_;
  bool on_its_way_ = false, stopping_ = false;
  // One for all views: TBB keeps some memory of every thread that ever ran a loop.
  std::thread thread_;
};

}  // namespace fringeslam
