// SPDX-License-Identifier: Apache-2.0
#include "tools/progress.h"

#include <unistd.h>

#include <cstdio>

namespace fringeslam::tools {

Progress::Progress(std::string what, int total, bool silent)
    : what_(std::move(what)),
      total_(total),
      silent_(silent),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      printed_(start_) {}

Progress::~Progress() {
  if (!silent_ && terminal_ && done_ > 0) std::fputc('\n', stderr);
}

void Progress::step(const std::string& more) {
  ++done_;
  const bool last = done_ == total_;
  const auto interval = terminal_ ? std::chrono::milliseconds(100) : std::chrono::seconds(5);
  if (!silent_ && (last || Clock::now() - printed_ >= interval)) print(last, more);
}

void Progress::print(bool last, const std::string& more) {
  printed_ = Clock::now();
  const double elapsed_s = std::chrono::duration<double>(printed_ - start_).count();
  const double rate = done_ / elapsed_s;
  std::string tail = last ? std::to_string(elapsed_s) : std::to_string((total_ - done_) / rate);
  tail.resize(tail.find('.') + 2);
  std::fprintf(stderr, "%s%s %d/%d  %.1f/s  %s s%s%s%s", terminal_ ? "\r" : "", what_.c_str(), done_, total_, rate,
               tail.c_str(), last ? "" : " left", more.c_str(), terminal_ ? "   " : "\n");
  std::fflush(stderr);
}

}  // namespace fringeslam::tools
