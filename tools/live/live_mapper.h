// SPDX-License-Identifier: Apache-2.0
// Maps captured stacks for the live page in a thread of its own, so that mapping never delays the capture. The map serves
// the page only; `fringeslam run` maps the dataset afterwards.
#pragma once

#include <atomic>
#include <thread>

#include "core/base/bounded_queue.h"
#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"
#include "tools/live/live_feed.h"

namespace fringeslam::tools {

// Shows a mapped stack, and the warm objects found so far.
void show_mapped(LiveFeed& feed, const FringeStack& stack, const FrameResult& result, const Mapper& mapper,
                 const ThermalView& thermal, const ThermalObserver& observer, int dropped);

class LiveMapper {
 public:
  // The feed must outlive the mapper.
  LiveMapper(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options, LiveFeed& feed);
  // Discards the stacks that are waiting.
  ~LiveMapper();
  LiveMapper(const LiveMapper&) = delete;
  LiveMapper& operator=(const LiveMapper&) = delete;

  // Never waits: if more than two stacks are waiting, the oldest is dropped. The images are shared and must not change.
  void offer(const FringeStack& stack);
  // Waits until all offered stacks are shown or dropped.
  void finish();
  int dropped() const { return queue_.dropped(); }

 private:
  void map(const FringeStack& stack);

  Pipeline pipeline_;
  ThermalObserver thermal_;
  LiveFeed& feed_;
  bool failed_ = false;  // shows images only from now on; used by the thread
  BoundedQueue<FringeStack> queue_{2, WhenFull::keep_latest};
  int offered_ = 0;
  std::atomic<int> shown_ = 0;
  std::thread thread_;  // last: it uses the other members
};

}  // namespace fringeslam::tools
