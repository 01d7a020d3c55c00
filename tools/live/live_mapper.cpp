// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_mapper.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <utility>

namespace fringeslam::tools {

void show_mapped(LiveFeed& feed, const FringeStack& stack, const FrameResult& result, const Pipeline& pipeline,
                 int dropped) {
  feed.show(
      stack, result, pipeline.map(), [&] { return pipeline.trajectory(); }, dropped);
  if (result.warm.list.empty()) return;
  std::vector<VictimCandidate> candidates;
  for (const WarmThing& thing : pipeline.warm_things())
    candidates.push_back({thing.position_m, thing.extent_m, thing.victim ? "may be a victim" : "warm, no victim",
                          thing.reason, thing.victim});
  std::stable_partition(candidates.begin(), candidates.end(), [](const VictimCandidate& c) { return c.victim; });
  feed.show_candidates(std::move(candidates));
}

LiveMapper::LiveMapper(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
                       LiveFeed& feed)
    : pipeline_(rig, sequence, options, Pose{}), feed_(feed), thread_([this] { work(); }) {}

LiveMapper::~LiveMapper() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void LiveMapper::offer(const FringeStack& stack) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(stack);
    if (waiting_.size() > kWaiting) {
      waiting_.pop_front();
      ++dropped_;
    }
  }
  changed_.notify_all();
}

void LiveMapper::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return waiting_.empty() && !mapping_; });
}

int LiveMapper::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

void LiveMapper::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return stopping_ || !waiting_.empty(); });
    if (stopping_) return;
    const FringeStack stack = std::move(waiting_.front());
    waiting_.pop_front();
    mapping_ = true;
    lock.unlock();
    map(stack);
    lock.lock();
    mapping_ = false;
    changed_.notify_all();
  }
}

void LiveMapper::map(const FringeStack& stack) {
  if (failed_) return feed_.show(stack);
  try {
    const FrameResult result = pipeline_.process(stack);
    show_mapped(feed_, stack, result, pipeline_, dropped());
  } catch (const std::exception& e) {
    failed_ = true;
    std::fprintf(stderr, "live: no map from stack %d on: %s\n", stack.index, e.what());
    feed_.show(stack);
  }
}

}  // namespace fringeslam::tools
