// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_mapper.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <utility>

namespace fringeslam::tools {

void show_mapped(LiveFeed& feed, const FringeStack& stack, const FrameResult& result, const Mapper& mapper,
                 const ThermalView& thermal, const ThermalObserver& observer, int dropped) {
  const bool moved = feed.show(
      stack, result, mapper.map(), [&] { return mapper.trajectory(); }, dropped);
  if (thermal.warm.list.empty() && !moved) return;
  std::vector<WarmObjectMark> candidates;
  for (const WarmObject& thing : observer.warm_objects(mapper))
    candidates.push_back({thing.position_m, thing.extent_m, thing.victim ? "may be a victim" : "warm, no victim",
                          thing.reason, thing.victim});
  std::stable_partition(candidates.begin(), candidates.end(), [](const WarmObjectMark& c) { return c.victim; });
  feed.show_candidates(std::move(candidates));
}

LiveMapper::LiveMapper(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
                       LiveFeed& feed)
    : pipeline_(rig, sequence, options, Pose{}), thermal_(rig, options.thermal), feed_(feed) {
  thread_ = std::thread([this] {
    while (const std::optional<FringeStack> stack = queue_.pop()) {
      map(*stack);
      ++shown_;
      shown_.notify_all();
    }
  });
}

LiveMapper::~LiveMapper() {
  queue_.cancel();
  thread_.join();
}

void LiveMapper::offer(const FringeStack& stack) {
  queue_.push(stack);
  ++offered_;
}

void LiveMapper::finish() {
  const int to_show = offered_ - queue_.dropped();
  for (int shown = shown_; shown < to_show; shown = shown_) shown_.wait(shown);
}

void LiveMapper::map(const FringeStack& stack) {
  if (failed_) return feed_.show(stack);
  try {
    const FrameResult result = pipeline_.process(stack);
    show_mapped(feed_, stack, result, pipeline_.mapper(), thermal_.observe(stack, result), thermal_, dropped());
  } catch (const std::exception& e) {
    failed_ = true;
    std::fprintf(stderr, "live: no map from stack %d on: %s\n", stack.index, e.what());
    feed_.show(stack);
  }
}

}  // namespace fringeslam::tools
