// SPDX-License-Identifier: Apache-2.0
// For whoever may be slower than the camera, and must not make it wait: stacks are taken from another rig in a thread
// of its own and kept until they are asked for. Of more than a few the oldest is dropped, and counted.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

#include "core/rig/rig.h"

namespace fringeslam {

enum class Pace {
  free,        // as fast as the rig gives stacks: a camera keeps its own time
  timestamps,  // as fast as they were taken, for what was recorded or is simulated
};

class DroppingRig : public Rig {
 public:
  // Keeps up to `capacity` stacks. The inner rig has to outlive it and is its own until it ends. Patterns are asked for
  // that were last asked of this one, at first `sequence`.
  DroppingRig(Rig& inner, const PatternSequence& sequence, size_t capacity, Pace pace);
  // Waits for the stack that is being taken.
  ~DroppingRig() override;

  const RigModel& model() const override { return inner_.model(); }
  // The oldest stack that was kept; waits for one. Stacks of other patterns than these are dropped. Throws what the
  // inner rig threw, after the stacks that came before.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  // So far.
  int dropped() const;

 private:
  struct Kept {
    FringeStack stack;
    PatternSequence patterns;
  };
  void take();
  std::optional<FringeStack> next(const PatternSequence& patterns);
  bool wait_for_its_time(const FringeStack& stack);

  Rig& inner_;
  const size_t capacity_;
  const Pace pace_;
  mutable std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  PatternSequence wanted_;
  std::deque<Kept> kept_;
  int dropped_ = 0;
  bool ended_ = false, stopping_ = false;
  std::exception_ptr failure_;
  std::optional<std::chrono::steady_clock::time_point> start_;
  double first_s_ = 0;
  std::thread taking_;  // the last: it uses the others
};

}  // namespace fringeslam
