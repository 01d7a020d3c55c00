// SPDX-License-Identifier: Apache-2.0
// Measuring scripts in other languages.
#pragma once

#include <string>

namespace fringeslam::bench {

// Runs a shell command and returns what it prints to standard output, at most 64 KiB; empty if it cannot be started.
std::string output_of(const std::string& command);

}  // namespace fringeslam::bench
