// SPDX-License-Identifier: Apache-2.0
// The driver loop: captures stacks, preprocesses them and maps them, several at a time. While the pipeline maps one view,
// other threads capture and reconstruct the next ones. The results equal those of one view at a time, unless the robot
// starts to move: the views that were requested before are captured with all patterns.
#pragma once

#include <functional>
#include <future>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "core/base/bounded_queue.h"
#include "core/base/core_share.h"
#include "core/mapper/pipeline.h"

namespace fringeslam {

struct MappedView {
  FringeStack stack;
  FrameResult result;
};

class Driver {
 public:
  // Captures one stack with these patterns; empty at the end. Called from other threads, one call at a time.
  using Capture = std::function<std::optional<FringeStack>(const PatternSequence&)>;

  // Mapping takes less time than preprocessing, except for keyframes, which take much more.
  static constexpr int kAhead = 4;
  // `ahead` is the number of stacks that may be captured before the pipeline needs them; each adds to the latency when
  // mapping lags behind. The pipeline must outlive the driver.
  Driver(Capture capture, Pipeline& pipeline, int ahead = kAhead);
  // Drives a rig, or anything else with Rig's capture(), which must outlive the driver.
  template <class AnyRig>
  requires requires(AnyRig& rig, const PatternSequence& patterns) { rig.capture(patterns); }
  Driver(AnyRig& rig, Pipeline& pipeline, int ahead = kAhead)
      : Driver(Capture([&rig](const PatternSequence& patterns) { return rig.capture(patterns); }), pipeline, ahead) {
    if constexpr (requires { rig.can_change_patterns(); }) {
      if (!rig.can_change_patterns()) pipeline.keep_all_patterns();
    }
  }
  // Waits for stacks that are being captured or preprocessed.
  ~Driver();
  Driver(const Driver&) = delete;
  Driver& operator=(const Driver&) = delete;

  // Returns the next view in the order of capture; empty at the end. Throws what capturing and the pipeline throw; after
  // capturing has failed there are no more views.
  std::optional<MappedView> next();
  // Maps all views and calls `observe` after each, in this thread.
  void run(const std::function<void(const MappedView&)>& observe);

 private:
  using Preprocessed = std::optional<PreprocessedStack>;  // empty: no more stacks
  static constexpr int kThreads = 2;

  void work();
  void stop();
  void request(size_t views);

  Capture capture_;
  Pipeline& pipeline_;
  const size_t ahead_;
  size_t requested_ = 0;  // and not returned yet
  bool finished_ = false;
  CoreShare cores_;
  BoundedQueue<PatternSequence> requests_;
  BoundedQueue<std::future<Preprocessed>> views_;  // in the order of capture
  std::mutex capturing_;                           // held while a stack is captured
  bool ended_ = false;                             // guarded by capturing_
  // They live as long as the driver: TBB keeps memory for every thread that ever ran a loop.
  std::vector<std::thread> threads_;
};

}  // namespace fringeslam
