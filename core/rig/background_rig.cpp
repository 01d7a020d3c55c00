// SPDX-License-Identifier: Apache-2.0
#include "core/rig/background_rig.h"

#include <algorithm>
#include <utility>

namespace fringeslam {

BackgroundRig::BackgroundRig(Rig& inner, const PatternSequence& sequence, size_t capacity, Pace pace,
                             std::function<bool()> ends)
    : inner_(inner), pace_(pace), ends_(std::move(ends)), queue_(capacity, WhenFull::keep_latest), wanted_(sequence) {
  thread_ = std::thread([this] { work(); });
}

BackgroundRig::~BackgroundRig() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stopped_.notify_all();
  queue_.cancel();
  thread_.join();
}

// Returns false if the captures are to end before that time. Compares seconds, since timestamps may exceed the range of the clock.
bool BackgroundRig::wait_until(Clock::time_point start, double since_start_s) {
  constexpr double kAsks_s = 0.1;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const double left_s = since_start_s - std::chrono::duration<double>(Clock::now() - start).count();
    if (left_s <= 0) return true;
    if (ends_()) return false;
    stopped_.wait_for(lock, std::chrono::duration<double>(std::min(left_s, kAsks_s)));
  }
  return false;
}

void BackgroundRig::work() {
  Clock::time_point start;
  std::optional<double> first_s;
  while (true) {
    std::unique_lock lock(mutex_);
    const PatternSequence patterns = wanted_;
    lock.unlock();
    std::optional<FringeStack> stack;
    try {
      stack = inner_.capture(patterns);
    } catch (...) {
      const std::lock_guard guard(mutex_);
      failure_ = std::current_exception();
    }
    if (!stack) return queue_.close();
    if (pace_ == Pace::timestamps) {
      if (!first_s) start = Clock::now(), first_s = stack->timestamp_s;
      if (!wait_until(start, stack->timestamp_s - *first_s)) return queue_.close();
    }
    if (!queue_.push(std::move(*stack))) return;
  }
}

std::optional<FringeStack> BackgroundRig::capture(const PatternSequence& sequence) {
  {
    const std::lock_guard lock(mutex_);
    wanted_ = sequence;
  }
  while (std::optional<FringeStack> stack = queue_.pop()) {
    if (stack->patterns == sequence) return stack;
    ++other_patterns_;
  }
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  return std::nullopt;
}

}  // namespace fringeslam
