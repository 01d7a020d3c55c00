// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/conveyor.h"

#include <utility>

namespace fringeslam {

Conveyor::Conveyor(Capture capture, Pipeline& pipeline) : capture_(std::move(capture)), pipeline_(pipeline) {
  thread_ = std::thread([this] { look_ahead(); });
}

Conveyor::~Conveyor() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Conveyor::look_ahead() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return asked_ || stopping_; });
    if (stopping_) return;
    const PatternSequence patterns = *std::exchange(asked_, std::nullopt);
    lock.unlock();
    Ahead seen;
    std::exception_ptr failure;
    try {
      if (std::optional<FringeStack> stack = capture_(patterns)) seen = pipeline_.see_ahead(std::move(*stack));
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    answer_ = std::move(seen);
    failure_ = failure;
    changed_.notify_all();
  }
}

void Conveyor::ask(const PatternSequence& patterns) {
  const std::lock_guard lock(mutex_);
  asked_ = patterns;
  on_its_way_ = true;
  changed_.notify_all();
}

Conveyor::Ahead Conveyor::answer() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return answer_.has_value(); });
  on_its_way_ = false;
  Ahead seen = std::move(*std::exchange(answer_, std::nullopt));
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  return seen;
}

std::optional<Conveyor::View> Conveyor::next() {
  if (!on_its_way_) ask(pipeline_.next_patterns());
  Ahead seen = answer();
  if (!seen) return std::nullopt;
  if (pipeline_.knows_patterns_ahead()) ask(pipeline_.next_patterns());
  FringeStack stack = seen->stack;  // shares its images
  FrameResult result = pipeline_.process(std::move(*seen));
  return View{std::move(stack), std::move(result)};
}

}  // namespace fringeslam
