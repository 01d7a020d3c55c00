// SPDX-License-Identifier: Apache-2.0
// Where the time of a run goes. For people only: outputs do not depend on time.
#pragma once

#include <chrono>
#include <map>
#include <string>

namespace fringeslam {

class StageClock {
 public:
  // A view's images are there.
  void begin_view() {
    view_ = std::chrono::steady_clock::now();
    entered_.clear();
  }
  // The stage before ends here.
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

  // Of each stage so far, the present one left out.
  const std::map<std::string, double>& seconds() const { return seconds_; }
  // When each stage was first entered in this view, after its beginning.
  const std::map<std::string, double>& entered() const { return entered_; }

 private:
  std::string stage_;
  std::chrono::steady_clock::time_point since_, view_;
  std::map<std::string, double> seconds_, entered_;
};

}  // namespace fringeslam
