// SPDX-License-Identifier: Apache-2.0
// Compares what the program writes for any number of threads, instruction sets and shards, byte by byte.
//
// A trial of an instruction set runs the program as on a processor that has no wider one: FRINGESLAM_INSTRUCTION_SET selects
// the kernels, and OPENCV_CPU_DISABLE and GLIBC_TUNABLES restrict OpenCV and the C library likewise.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::robust {

struct BitOptions {
  std::vector<int> threads = {1, 2, 3, 8}, shards = {1, 2, 3};
  bool every_pair = true;          // false: each number of threads with one instruction set only
  double minutes = 0;              // stop after this time; 0: no limit
  std::filesystem::path scene;     // empty: a small one
  std::vector<std::string> tasks;  // of kBitTasks; empty: all
};

extern const std::vector<std::string> kBitTasks;

struct BitReport {
  int compared = 0, files = 0;           // trials; files of a reference, all tasks together
  std::vector<std::string> differences;  // one line for each trial that differs from the reference
  std::vector<std::string> sets;         // instruction sets of this processor
  uint64_t digest = 0;                   // of all files of the reference, to compare computers
};

// Runs each task on all threads with the widest instruction set, then with all others, in `folder`, which has to exist
// and be empty. Throws Error if the program fails.
BitReport compare_bits(const std::filesystem::path& program, const std::filesystem::path& folder,
                       const BitOptions& options);

}  // namespace fringeslam::robust
