// SPDX-License-Identifier: Apache-2.0
// Prints one progress line with rate and remaining time to standard error; a new line every few seconds if that is not
// a terminal.
#pragma once

#include <chrono>
#include <string>

namespace fringeslam::tools {

class Progress {
 public:
  Progress(std::string what, int total, bool silent);
  ~Progress();
  void step(const std::string& more = "");  // `more` is printed after the time

 private:
  void print(bool last, const std::string& more);
  using Clock = std::chrono::steady_clock;
  std::string what_;
  int total_, done_ = 0;
  bool silent_, terminal_;
  Clock::time_point start_, printed_;
};

}  // namespace fringeslam::tools
