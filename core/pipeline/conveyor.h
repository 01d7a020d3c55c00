// SPDX-License-Identifier: Apache-2.0
// Views one after the other, two at a time: while the pipeline registers one, another thread captures the next, decodes
// it and reconstructs its depth. The results are those of one at a time, whatever the threads' pace.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "core/pipeline/pipeline.h"

namespace fringeslam {

class Conveyor {
 public:
  // The images of one pass through these patterns; empty when there is nothing more to see. Called in the other thread.
  using Capture = std::function<std::optional<FringeStack>(const PatternSequence&)>;

  // The pipeline has to outlive it.
  Conveyor(Capture capture, Pipeline& pipeline);
  // Waits for the view that is on its way.
  ~Conveyor();
  Conveyor(const Conveyor&) = delete;
  Conveyor& operator=(const Conveyor&) = delete;

  struct View {
    FringeStack stack;
    FrameResult result;
  };
  // Empty when there is nothing more to see. Throws what `capture` and the pipeline throw.
  std::optional<View> next();

 private:
  using Ahead = std::optional<SeenStack>;
  void ask(const PatternSequence& patterns);
  Ahead answer();
  void look_ahead();

  Capture capture_;
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
