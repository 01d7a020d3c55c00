// SPDX-License-Identifier: Apache-2.0
#include "tools/report/picture_workers.h"

#include <nlohmann/json.hpp>

#include "core/types/error.h"

namespace fringeslam::tools {

using namespace studies;
using nlohmann::ordered_json;

namespace {

// Returns a worker's answer or, if the worker died, what its result line says.
ordered_json answer_of(const std::string& line) {
  ordered_json answer = ordered_json::parse(line, nullptr, false);
  if (answer.is_object() && (answer.contains("views") || answer.contains("unpictured"))) return answer;
  const std::string message = answer.is_object() ? answer.value("message", "") : "";
  return {{"unpictured", "The repeated run for its pictures ended without an answer: " + message}};
}

}  // namespace

std::map<int, ordered_json> pictures_of(const Study& study, const std::vector<WorstTrial>& trials,
                                        const WorkerOptions& workers, const std::function<bool()>& stop) {
  std::map<int, ordered_json> pictures;
  std::vector<int> again;
  for (const WorstTrial& trial : trials) {
    if (trial.outcome == to_string(Outcome::timed_out))
      pictures[trial.trial] = {{"unpictured", "It timed out in the study and was not run again."}};
    else
      again.push_back(trial.trial);
  }
  if (again.empty()) return pictures;
  run_trials(
      study, again, workers, [&](int trial, const std::string& line) { pictures[trial] = answer_of(line); }, stop);
  if (stop()) throw Error("interrupted; the results are kept, report.html was not written");
  return pictures;
}

}  // namespace fringeslam::tools
