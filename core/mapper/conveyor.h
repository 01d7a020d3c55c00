// SPDX-License-Identifier: Apache-2.0
// Views one after the other, several at a time: while the pipeline registers one, other threads capture the next ones,
// decode them and reconstruct their depth. The results are those of one at a time, whatever the threads' pace.
#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "core/mapper/pipeline.h"

namespace fringeslam {

class Conveyor {
 public:
  // The images of one pass through these patterns; empty when there is nothing more to see. Called in other threads,
  // one call after the other.
  using Capture = std::function<std::optional<FringeStack>(const PatternSequence&)>;

  static constexpr int kAhead = 4;
  // The pipeline has to outlive it. `ahead`: how many views may be on their way; the pipeline needs less time for a
  // view than the view to come, but much more for a keyframe. When it is behind, each is one more of latency.
  Conveyor(Capture capture, Pipeline& pipeline, int ahead = kAhead);
  // Waits for the views that are on their way.
  ~Conveyor();
  Conveyor(const Conveyor&) = delete;
  Conveyor& operator=(const Conveyor&) = delete;

  struct View {
    FringeStack stack;
    FrameResult result;
  };
  // Empty when there is nothing more to see. Throws what `capture` and the pipeline throw; after `capture` did there is
  // nothing more to see.
  std::optional<View> next();

 private:
  static constexpr int kThreads = 2;

  struct Arrival {
    std::optional<SeenStack> seen;  // empty: nothing more to see
    std::exception_ptr failure;
  };
  // From the moment on at which a core is free for it, as long as it lives.
  class Turn;
  void work();
  Arrival take();
  void let_come(int views);

  Capture capture_;
  Pipeline& pipeline_;
  int ahead_;
  std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  PatternSequence patterns_;
  int wanted_ = 0, captured_ = 0, taken_ = 0;  // views so far
  std::map<int, Arrival> arrived_;             // by their number, and not taken yet
  bool capturing_ = false, ended_ = false, stopping_ = false;
  // On few cores: more threads at work than those would push each other's images out of the caches. So views to come
  // wait for a core, and while they have the others the pipeline's loops run alone.
  int cores_, at_work_ = 0;
  std::atomic<bool> no_core_left_ = false;  // for the pipeline's loops but its own
  // The same for all views: TBB keeps some memory of every thread that ever ran a loop.
  std::vector<std::thread> threads_;
};

}  // namespace fringeslam
