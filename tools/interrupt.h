// SPDX-License-Identifier: Apache-2.0
// Lets loops end at their next iteration on Ctrl-C, on SIGTERM and when the terminal is closed, so that their results so far are
// kept.
#pragma once

namespace fringeslam::tools {

// Exit code of a program that Ctrl-C ended.
constexpr int kInterrupted = 130;

// Installs the signal handlers. SIGPIPE does not end the program: writing to a pipe without a reader fails instead.
void catch_interrupts();
// True once a signal has arrived.
bool interrupted();

// Sleeps; returns early when interrupted.
void wait_s(double seconds);

}  // namespace fringeslam::tools
