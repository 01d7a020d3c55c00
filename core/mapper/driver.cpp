// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/driver.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/start_threads.h"

namespace fringeslam {

Driver::Driver(Capture capture, Pipeline& pipeline, int ahead)
    : capture_(std::move(capture)),
      pipeline_(pipeline),
      ahead_(static_cast<size_t>(std::max(1, ahead))),
      cores_(std::max(1, cv::getNumThreads())),
      requests_(ahead_, WhenFull::keep_all),
      views_(ahead_, WhenFull::keep_all) {
  threads_ = start_threads(std::vector<std::function<void()>>(kThreads, [this] { work(); }), [this] { stop(); });
}

Driver::~Driver() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

void Driver::stop() {
  requests_.cancel();
  cores_.stop();
}

void Driver::work() {
  const SerialLoops serial;  // the other cores belong to the other threads
  while (true) {
    std::promise<Preprocessed> promise;
    Preprocessed preprocessed;
    try {
      std::optional<FringeStack> stack;
      {
        const std::lock_guard lock(capturing_);
        const std::optional<PatternSequence> patterns = requests_.pop();
        if (!patterns) return;
        views_.push(promise.get_future());
        // Should it throw, nothing more is captured.
        if (!std::exchange(ended_, true)) stack = capture_(*patterns);
        ended_ = !stack;
      }
      if (stack) {
        const CoreShare::Turn turn(cores_, true);
        preprocessed = pipeline_.preprocess(std::move(*stack));
      }
    } catch (...) {
      promise.set_exception(std::current_exception());
      continue;
    }
    promise.set_value(std::move(preprocessed));
  }
}

void Driver::request(size_t views) {
  for (; requested_ < views; ++requested_) requests_.push(pipeline_.next_patterns());
}

std::optional<MappedView> Driver::next() {
  if (finished_) return std::nullopt;
  request(pipeline_.has_fixed_patterns() ? ahead_ : 1);
  std::future<Preprocessed> future = std::move(*views_.pop());
  --requested_;
  Preprocessed preprocessed = future.get();
  finished_ = !preprocessed;
  if (finished_) return std::nullopt;
  if (pipeline_.has_fixed_patterns()) request(ahead_);
  FringeStack stack = preprocessed->stack;  // shares its images
  // The oldest view does not wait for a core, and has all of them as soon as the others are done.
  const CoreShare::Turn turn(cores_, false);
  const SerialLoops serial(cores_.none_left());
  FrameResult result = pipeline_.process(std::move(*preprocessed));
  return MappedView{std::move(stack), std::move(result)};
}

void Driver::run(const std::function<void(const MappedView&)>& observe) {
  while (const std::optional<MappedView> view = next()) observe(*view);
}

}  // namespace fringeslam
