// SPDX-License-Identifier: Apache-2.0
// The program's command line.
#pragma once

namespace fringeslam::tools {

// Runs the verb that the arguments name, as the program does, and returns its exit code.
int run_program(int argc, char** argv);

}  // namespace fringeslam::tools
