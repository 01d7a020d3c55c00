// SPDX-License-Identifier: Apache-2.0
#include "core/rig/dropping_rig.h"

#include <algorithm>
#include <utility>

namespace fringeslam {

using Clock = std::chrono::steady_clock;

DroppingRig::DroppingRig(Rig& inner, const PatternSequence& sequence, size_t capacity, Pace pace)
    : inner_(inner), capacity_(std::max<size_t>(capacity, 1)), pace_(pace), wanted_(sequence) {
  taking_ = std::thread([this] { take(); });
}

DroppingRig::~DroppingRig() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  taking_.join();
}

void DroppingRig::take() {
  while (true) {
    std::unique_lock lock(mutex_);
    if (stopping_) return;
    Kept kept{{}, wanted_};
    lock.unlock();
    std::optional<FringeStack> stack = next(kept.patterns);
    if (stack && !wait_for_its_time(*stack)) return;
    lock.lock();
    if (!stack) {
      ended_ = true;
      changed_.notify_all();
      return;
    }
    kept.stack = std::move(*stack);
    kept_.push_back(std::move(kept));
    if (kept_.size() > capacity_) {
      kept_.pop_front();
      ++dropped_;
    }
    changed_.notify_all();
  }
}

std::optional<FringeStack> DroppingRig::next(const PatternSequence& patterns) {
  try {
    return inner_.capture(patterns);
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    return std::nullopt;
  }
}

// As long after the first stack as its timestamp says; false when nobody wants it any more.
bool DroppingRig::wait_for_its_time(const FringeStack& stack) {
  if (pace_ == Pace::free) return true;
  std::unique_lock lock(mutex_);
  if (!start_) start_ = Clock::now(), first_s_ = stack.timestamp_s;
  const auto due = *start_ + std::chrono::duration_cast<Clock::duration>(
                                 std::chrono::duration<double>(stack.timestamp_s - first_s_));
  return !changed_.wait_until(lock, due, [&] { return stopping_; });
}

std::optional<FringeStack> DroppingRig::capture(const PatternSequence& sequence) {
  std::unique_lock lock(mutex_);
  wanted_ = sequence;
  while (true) {
    while (!kept_.empty() && !(kept_.front().patterns == sequence)) kept_.pop_front(), ++dropped_;
    if (!kept_.empty()) break;
    if (ended_) {
      if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
      return std::nullopt;
    }
    changed_.wait(lock);
  }
  FringeStack stack = std::move(kept_.front().stack);
  kept_.pop_front();
  return stack;
}

int DroppingRig::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

}  // namespace fringeslam
