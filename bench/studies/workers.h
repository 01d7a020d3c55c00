// SPDX-License-Identifier: Apache-2.0
// Trials in separate processes: one that crashes, hangs or exhausts the memory does no other harm.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "bench/studies/trial_run.h"

namespace fringeslam::studies {

struct WorkerOptions {
  int jobs = 1;
  std::vector<std::string> command;  // worker command: reads trial numbers, one per line, and answers each with a line
};

struct WorkersReport {
  double largest_mib = 0;  // peak resident memory of the largest worker
  int restarted = 0;
};

// Runs the trials and reports each one's line when it arrives, in arbitrary order. A worker that dies or exceeds the
// study's time limit yields that trial's result and is replaced. Ends early when `stop` returns true.
WorkersReport run_trials(const Study& study, const std::vector<int>& trials, const WorkerOptions& options,
                         const std::function<void(int trial, const std::string& line)>& tell,
                         const std::function<bool()>& stop);

// Runs a worker: answers each trial number with a line until its input ends.
void work(const Study& study, const std::function<std::string(const Trial&)>& answer);

}  // namespace fringeslam::studies
