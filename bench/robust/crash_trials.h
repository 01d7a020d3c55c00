// SPDX-License-Identifier: Apache-2.0
// Kills the program at its system calls, or makes them fail, and checks that no result is lost.
//
// Each trial starts from a folder in which earlier results exist, with files of a user in them. Afterwards
//  - a result folder is, byte for byte, the earlier result or the complete new one,
//  - the user's files and a saved map exist unchanged,
//  - a command that did not succeed printed one line that names no temporary file, and exited with 2,
//  - a command that succeeded left the complete new result, whatever happened to it,
//  - the next command removes the leftovers of a killed one,
//  - the map that a killed run had saved can be recovered.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::robust {

struct CrashPrograms {
  std::filesystem::path fringeslam, inject_fault, record_stacks;
};

struct CrashOptions {
  int kills_per_task = 10, failures_per_task = 10;  // at most the number of a task's calls, at even distances
  double minutes = 0;                               // stop after this time; 0: no limit
  uint64_t seed = 1;                                // of the calls within these distances
  std::vector<std::string> tasks;                   // of kCrashTasks; empty: all
};

extern const std::vector<std::string> kCrashTasks;

struct CrashReport {
  int kills = 0, failures = 0;      // trials
  int hit = 0;                      // trials in which the call was reached
  std::vector<std::string> losses;  // one line for each trial that broke a promise
  bool possible = true;             // false: processes cannot be traced on this computer
};

// Runs the trials in `folder`, which has to exist and be empty. Throws Error if a task fails without a fault.
CrashReport crash_trials(const CrashPrograms& programs, const std::filesystem::path& folder,
                         const CrashOptions& options);

}  // namespace fringeslam::robust
