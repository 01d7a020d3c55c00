// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/conveyor.h"

#include <algorithm>
#include <utility>

#include "core/base/parallel.h"

namespace fringeslam {

// Of a view that was captured, or of the one that the pipeline processes. That one does not wait: it is the oldest, and
// shares a core until the first of the others is done.
class Conveyor::Turn {
 public:
  struct Wait {};
  explicit Turn(Conveyor& conveyor) : conveyor_(conveyor) {
    const std::lock_guard lock(conveyor_.mutex_);
    count(1);
  }
  Turn(Conveyor& conveyor, Wait) : conveyor_(conveyor) {
    std::unique_lock lock(conveyor_.mutex_);
    conveyor_.changed_.wait(lock, [&] { return conveyor_.stopping_ || conveyor_.at_work_ < conveyor_.cores_; });
    count(1);
  }
  ~Turn() {
    const std::lock_guard lock(conveyor_.mutex_);
    count(-1);
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  void count(int more) {
    conveyor_.at_work_ += more;
    conveyor_.no_core_left_ = conveyor_.at_work_ >= conveyor_.cores_;
    conveyor_.changed_.notify_all();
  }
  Conveyor& conveyor_;
};

Conveyor::Conveyor(Capture capture, Pipeline& pipeline, int ahead)
    : capture_(std::move(capture)),
      pipeline_(pipeline),
      ahead_(std::max(1, ahead)),
      cores_(std::max(1, cv::getNumThreads())) {
  for (int i = 0; i < kThreads; ++i) threads_.emplace_back([this] { work(); });
}

Conveyor::~Conveyor() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void Conveyor::work() {
  const SerialLoops alone;  // the other cores are for the other threads
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return stopping_ || (captured_ < wanted_ && !capturing_ && !ended_); });
    if (stopping_) return;
    const int number = captured_++;
    const PatternSequence patterns = patterns_;
    capturing_ = true;
    lock.unlock();
    Arrival arrival;
    std::optional<FringeStack> stack;
    try {
      stack = capture_(patterns);
    } catch (...) {
      arrival.failure = std::current_exception();
    }
    lock.lock();
    capturing_ = false;
    ended_ = !stack;
    changed_.notify_all();
    lock.unlock();
    try {
      if (stack) {
        const Turn turn(*this, Turn::Wait{});
        arrival.seen = pipeline_.see_ahead(std::move(*stack));
      }
    } catch (...) {
      arrival.failure = std::current_exception();
    }
    lock.lock();
    arrived_[number] = std::move(arrival);
    changed_.notify_all();
  }
}

void Conveyor::let_come(int views) {
  const std::lock_guard lock(mutex_);
  patterns_ = pipeline_.next_patterns();
  wanted_ = taken_ + views;
  changed_.notify_all();
}

Conveyor::Arrival Conveyor::take() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return arrived_.contains(taken_) || (ended_ && !capturing_ && captured_ == taken_); });
  if (!arrived_.contains(taken_)) return {};
  return std::move(arrived_.extract(taken_++).mapped());
}

std::optional<Conveyor::View> Conveyor::next() {
  const bool known = pipeline_.knows_patterns_ahead();
  let_come(known ? ahead_ : 1);
  Arrival arrival = take();
  if (arrival.failure) std::rethrow_exception(arrival.failure);
  if (!arrival.seen) return std::nullopt;
  if (known) let_come(ahead_);
  FringeStack stack = arrival.seen->stack;  // shares its images
  const Turn turn(*this);
  const SerialLoops alone(no_core_left_);
  FrameResult result = pipeline_.process(std::move(*arrival.seen));
  return View{std::move(stack), std::move(result)};
}

}  // namespace fringeslam
