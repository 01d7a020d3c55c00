// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and SIGTERM end a loop at its next turn, so that what it made so far is kept.
#pragma once

namespace fringeslam::tools {

void catch_interrupts();
bool interrupted();

// Returns early when interrupted.
void wait_s(double seconds);

}  // namespace fringeslam::tools
