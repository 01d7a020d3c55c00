// SPDX-License-Identifier: Apache-2.0
// One trial: a scene, a sensor, the pipeline, and the outcome.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "bench/studies/study.h"
#include "core/mapper/pipeline.h"
#include "core/types/truth.h"

namespace fringeslam::studies {

// How a trial ended. All but the first are failures; `cause` states the reason, from measurements against ground truth.
enum class Outcome {
  success,
  inaccurate,         // beyond the study's limits
  confidently_wrong,  // a motion error of more than 1 mm and 10 of its own sigmas
  lost,               // at least one view has no pose
  refused,            // the scene or the pipeline threw an error
  crashed,            // the process died, or a library threw an exception
  timed_out
};
std::string to_string(Outcome outcome);

struct TrialResult {
  int index = 0;
  Outcome outcome = Outcome::refused;
  std::string cause, message;                           // message: of an error
  std::vector<std::pair<std::string, double>> metrics;  // NaN: could not be measured
};

// Called for each view with the pipeline's result and the ground truth.
using ViewWatcher = std::function<void(const FrameResult&, const TruthFrame&)>;

// Runs a trial. Throws Error if it is refused because of the machine, not because of its values: if the study itself is no
// longer valid, because one of its files cannot be read, or if memory does not suffice.
TrialResult run_trial(const Study& study, const Trial& trial, const ViewWatcher& watch = {});

// Returns one line of JSON without newline: the study's hash, the trial's number, seed and values, and the result.
std::string to_line(const Study& study, const Trial& trial, const TrialResult& result);

}  // namespace fringeslam::studies
