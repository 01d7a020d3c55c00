// SPDX-License-Identifier: Apache-2.0
// Where the time of a run goes. For people only: outputs do not depend on time.
#pragma once

#include <chrono>
#include <map>
#include <string>

namespace fringeslam {

class StageClock {
 public:
  // The stage before ends here.
  void enter(const std::string& stage) {
    leave();
    stage_ = stage;
  }
  void leave() {
    const auto now = std::chrono::steady_clock::now();
    if (!stage_.empty()) seconds_[stage_] += std::chrono::duration<double>(now - since_).count();
    stage_.clear();
    since_ = now;
  }

  // Of each stage so far, the present one left out.
  const std::map<std::string, double>& seconds() const { return seconds_; }

 private:
  std::string stage_;
  std::chrono::steady_clock::time_point since_;
  std::map<std::string, double> seconds_;
};

}  // namespace fringeslam
