// SPDX-License-Identifier: Apache-2.0
// Measures the time spent in each stage, for reports only: no output depends on it.
#pragma once

#include <chrono>
#include <map>
#include <string>

namespace fringeslam {

class StageClock {
 public:
  // While an instance exists, enter_stage() reports to `clock` in the thread that created it.
  class Use {
   public:
    explicit Use(StageClock& clock) : before_(of_thread()) { of_thread() = &clock; }
    ~Use() { of_thread() = before_; }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    StageClock* before_;
  };

  // Call when a view's images have arrived.
  void begin_view() {
    view_ = std::chrono::steady_clock::now();
    entered_.clear();
  }
  // Starts a stage and ends the previous one.
  void enter(const std::string& stage) {
    leave();
    stage_ = stage;
    entered_.emplace(stage, std::chrono::duration<double>(since_ - view_).count());
  }
  void leave() {
    const auto now = std::chrono::steady_clock::now();
    if (!stage_.empty()) seconds_[stage_] += std::chrono::duration<double>(now - since_).count();
    stage_.clear();
    since_ = now;
  }

  // The clock of this thread; null if none is in use.
  static StageClock*& of_thread() {
    thread_local StageClock* clock = nullptr;
    return clock;
  }

  // Total time of each completed stage, s; excludes the stage in progress.
  const std::map<std::string, double>& seconds() const { return seconds_; }
  // The stage in progress; empty if there is none.
  const std::string& stage() const { return stage_; }
  // Time from the start of the view to the first entry of each stage, s.
  const std::map<std::string, double>& entered() const { return entered_; }

 private:
  std::string stage_;
  std::chrono::steady_clock::time_point since_, view_;
  std::map<std::string, double> seconds_, entered_;
};

// Starts a stage on this thread's clock, if it uses one.
inline void enter_stage(const char* stage) {
  if (StageClock* clock = StageClock::of_thread()) clock->enter(stage);
}

}  // namespace fringeslam
