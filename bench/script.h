// SPDX-License-Identifier: Apache-2.0
// The program under test and measuring scripts in other languages, as processes of their own.
#pragma once

#include <filesystem>
#include <string>

namespace fringeslam::bench {

// Runs a shell command and returns what it prints to standard output, at most 64 KiB; empty if it cannot be started.
std::string output_of(const std::string& command);

// Runs a script of the browser tests (needs tools/setup --test) with these arguments and returns the JSON text that it prints.
// Throws Error if it prints none.
std::string browser_result(const std::string& script, const std::string& arguments);

// Runs `fringeslam --json ARGUMENTS` and writes its answer to a file, and its messages to `messages` if that is given. Throws
// Error if it fails.
void run_program(const std::string& arguments, const std::filesystem::path& answer,
                 const std::filesystem::path& messages = {});

}  // namespace fringeslam::bench
