// SPDX-License-Identifier: Apache-2.0
#include "core/rig/background_rig.h"

#include <utility>

namespace fringeslam {

BackgroundRig::BackgroundRig(Rig& inner, const PatternSequence& sequence, size_t capacity, Pace pace)
    : inner_(inner), pace_(pace), queue_(capacity, WhenFull::keep_latest), wanted_(sequence) {
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

void BackgroundRig::work() {
  std::chrono::steady_clock::time_point start;
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
      if (!first_s) start = std::chrono::steady_clock::now(), first_s = stack->timestamp_s;
      const std::chrono::duration<double> since_first(stack->timestamp_s - *first_s);
      lock.lock();
      stopped_.wait_until(lock, start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(since_first),
                          [&] { return stopping_; });
      lock.unlock();
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
