// SPDX-License-Identifier: Apache-2.0
#include "tools/interrupt.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <thread>

namespace fringeslam::tools {

namespace {

std::atomic<bool> caught = false;

}  // namespace

void catch_interrupts() {
  const auto note = [](int) { caught = true; };
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
  if (std::signal(SIGHUP, note) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);  // as nohup wants it
  // Ctrl-C also ends a program that reads the messages, such as tee; writing them must not end this one before its results
  // are safe. Unlike an ignored signal, one with a handler is not inherited by started programs.
  std::signal(SIGPIPE, [](int) {});
}

bool interrupted() { return caught; }

void wait_s(double seconds) {
  using Clock = std::chrono::steady_clock;
  const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  for (auto now = Clock::now(); now < until && !caught; now = Clock::now())
    std::this_thread::sleep_for(std::min<Clock::duration>(until - now, std::chrono::milliseconds(50)));
}

}  // namespace fringeslam::tools
