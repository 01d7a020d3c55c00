// SPDX-License-Identifier: Apache-2.0
// Captures from another rig in the background, so that a slow consumer does not make the camera wait: stacks queue until
// they are requested, and beyond the queue's capacity the oldest are dropped and counted.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "core/base/bounded_queue.h"
#include "core/rig/rig.h"

namespace fringeslam {

enum class Pace {
  free,        // as fast as the rig delivers stacks; cameras keep their own time
  timestamps,  // at the stacks' timestamps, for recorded and simulated data
};

class BackgroundRig : public Rig {
 public:
  // Queues up to `capacity` stacks. The inner rig must outlive this one and must not be used by others. It captures the
  // patterns requested last, at first `sequence`. While it waits for a timestamp, it asks ten times a second whether to end
  // the captures.
  BackgroundRig(
      Rig& inner, const PatternSequence& sequence, size_t capacity, Pace pace,
      std::function<bool()> ends = [] { return false; });
  // Waits for the stack that is being captured.
  ~BackgroundRig() override;

  const RigModel& model() const override { return inner_.model(); }
  // Returns the oldest stack in the queue and waits for one; drops stacks with other patterns. Throws what the inner rig
  // threw, after the stacks captured before.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return inner_.inputs(); }
  // Number of stacks dropped so far.
  int dropped() const { return queue_.dropped() + other_patterns_; }

 private:
  using Clock = std::chrono::steady_clock;

  void work();
  bool wait_until(Clock::time_point start, double since_start_s);

  Rig& inner_;
  const Pace pace_;
  const std::function<bool()> ends_;
  BoundedQueue<FringeStack> queue_;
  std::atomic<int> other_patterns_ = 0;
  std::mutex mutex_;  // guards all members below
  std::condition_variable stopped_;
  PatternSequence wanted_;
  bool stopping_ = false;
  std::exception_ptr failure_;
  std::thread thread_;  // last: it uses the other members
};

}  // namespace fringeslam
