// SPDX-License-Identifier: Apache-2.0
// Runs a command of another system with limits on time and memory. Whatever it starts ends with it, even processes that
// it detached.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace fringeslam::evaluation {

struct ProcessLimits {
  double timeout_s = 300;
  double memory_mib = 8192;  // resident, of all its processes together
};

enum class ProcessEnd { finished, failed, timed_out, out_of_memory, interrupted };
std::string to_string(ProcessEnd end);

struct ProcessReport {
  ProcessEnd end = ProcessEnd::failed;
  int exit_code = -1;  // that of the shell; 128 + N for signal N
  double seconds = 0;
  double peak_mib = 0;          // largest sum over its processes, sampled 20 times per second
  bool left_processes = false;  // it ended before its own processes, which were killed
};

// Runs `command` by /bin/sh in `folder`; its output goes to the file `log`. Ends early when `stop` returns true. Must not
// be called while the program has other child processes. Throws Error if no process can be started.
ProcessReport run_limited(const std::string& command, const std::filesystem::path& folder,
                          const std::filesystem::path& log, const ProcessLimits& limits,
                          const std::function<bool()>& stop);

}  // namespace fringeslam::evaluation
