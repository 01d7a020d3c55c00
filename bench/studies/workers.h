// SPDX-License-Identifier: Apache-2.0
// Trials in processes of their own: one that crashes, hangs or eats the memory takes nothing with it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "bench/studies/trial_run.h"

namespace fringeslam::studies {

struct WorkerOptions {
  int jobs = 1;
  std::vector<std::string> command;  // of a worker: reads numbers of trials, a line each, and answers each by a line
};

struct WorkersReport {
  double largest_mib = 0;  // resident memory of the largest worker
  int restarted = 0;
};

// Runs the trials and tells each one's line as it comes, in no order. A worker that dies or takes longer than the study
// permits is that trial's result, and another one goes on. Ends early when `stop` says so.
WorkersReport run_trials(const Study& study, const std::vector<int>& trials, const WorkerOptions& options,
                         const std::function<void(int trial, const std::string& line)>& tell,
                         const std::function<bool()>& stop);

// What a worker does: answers until its input ends, by one line without its end.
void work(const Study& study, const std::function<std::string(const Trial&)>& answer);

}  // namespace fringeslam::studies
