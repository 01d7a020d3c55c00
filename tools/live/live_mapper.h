// SPDX-License-Identifier: Apache-2.0
// What is captured is mapped for the live page, in a thread of its own: the capture goes on whatever the mapping does.
// The map is the page's alone; `fringeslam run` maps the dataset for good.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "core/mapper/pipeline.h"
#include "tools/live/live_feed.h"

namespace fringeslam::tools {

// Shows what was made of a stack, and what is warm by what is known now.
void show_mapped(LiveFeed& feed, const FringeStack& stack, const FrameResult& result, const Pipeline& pipeline,
                 int dropped);

class LiveMapper {
 public:
  // The feed has to outlive it.
  LiveMapper(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options, LiveFeed& feed);
  // Drops what waits.
  ~LiveMapper();
  LiveMapper(const LiveMapper&) = delete;
  LiveMapper& operator=(const LiveMapper&) = delete;

  // Never waits: of more than two that are waiting the oldest is dropped. The images are shared and must not change.
  void offer(const FringeStack& stack);
  // Until all that waits is mapped and shown.
  void finish();
  int dropped() const;

 private:
  static constexpr size_t kWaiting = 2;
  void work();
  void map(const FringeStack& stack);

  Pipeline pipeline_;
  LiveFeed& feed_;
  bool failed_ = false;       // pictures alone from now on; of the thread
  mutable std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  std::deque<FringeStack> waiting_;
  int dropped_ = 0;
  bool mapping_ = false, stopping_ = false;
  std::thread thread_;  // the last: it uses the others
};

}  // namespace fringeslam::tools
