// SPDX-License-Identifier: Apache-2.0
// Tasks in separate processes: one that crashes, hangs or exhausts the memory does no other harm.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "bench/studies/trial_run.h"

namespace fringeslam::studies {

struct WorkerOptions {
  int jobs = 1;
  std::vector<std::string> command;  // worker command: reads task numbers, one per line, and answers each with a line
};

struct WorkersReport {
  double largest_mib = 0;  // peak resident memory of the largest worker
  int restarted = 0;
};

// How a worker ended before it answered a task.
struct WorkerEnd {
  bool timed_out = false;        // it was killed because the task took longer than the limit
  std::optional<int> exit_code;  // none if a signal ended it
  std::string message;
};

// Called when a task ends, in the process that distributes the tasks and in arbitrary order.
struct TaskEvents {
  std::function<void(int task, const std::string& line)> answered;
  std::function<void(int task, const WorkerEnd& end)> failed;  // its worker is replaced
  std::function<bool()> stop;                                  // true: end early
};

// Runs tasks, each for at most `timeout_s`.
WorkersReport run_tasks(const std::vector<int>& tasks, const WorkerOptions& options, double timeout_s,
                        const TaskEvents& events);

// Runs the trials of a study and reports each one's line when it arrives, in arbitrary order. A worker that dies or
// exceeds the study's time limit yields that trial's result. Ends early when `stop` returns true. Throws Error if a worker
// reports that a trial failed because of the machine; that trial has no result.
WorkersReport run_trials(const Study& study, const std::vector<int>& trials, const WorkerOptions& options,
                         const std::function<void(int trial, const std::string& line)>& tell,
                         const std::function<bool()>& stop);

// Runs a worker: answers each task number, below `tasks`, with a line until its input ends.
void work(int tasks, const std::function<std::string(int task)>& answer);
// The same for the trials of a study. An exception becomes the answer {"failed": message}.
void work(const Study& study, const std::function<std::string(const Trial&)>& answer);

}  // namespace fringeslam::studies
