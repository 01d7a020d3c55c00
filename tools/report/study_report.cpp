// SPDX-License-Identifier: Apache-2.0
#include "tools/report/study_report.h"

#include "bench/studies/rows.h"
#include "bench/studies/workers.h"
#include "core/types/error.h"
#include "tools/report/html_report.h"
#include "tools/report/report_page.h"
#include "tools/report/study_data.h"

namespace fringeslam::tools {

using namespace studies;
using nlohmann::ordered_json;

namespace {

// A worker's answer; or, of one that died, the line of results that stands for it.
ordered_json answer_of(const std::string& line) {
  ordered_json answer = ordered_json::parse(line, nullptr, false);
  if (answer.is_object() && (answer.contains("views") || answer.contains("unpictured"))) return answer;
  const std::string message = answer.is_object() ? answer.value("message", "") : "";
  return {{"unpictured", "Run again for its pictures, it ended without an answer: " + message}};
}

}  // namespace

std::map<int, ordered_json> pictures_of(const Study& study, const std::vector<WorstTrial>& trials,
                                        const StudyReportOptions& options) {
  std::map<int, ordered_json> pictures;
  std::vector<int> again;
  for (const WorstTrial& trial : trials) {
    if (trial.outcome == to_string(Outcome::timed_out))
      pictures[trial.trial] = {{"unpictured", "It took too long in the study and was not run again."}};
    else
      again.push_back(trial.trial);
  }
  if (again.empty()) return pictures;
  WorkerOptions workers;
  workers.jobs = options.jobs;
  workers.command = options.picture_worker;
  run_trials(
      study, again, workers, [&](int trial, const std::string& line) { pictures[trial] = answer_of(line); },
      options.stop);
  if (options.stop()) throw Error("interrupted; the results are kept, report.html is not written");
  return pictures;
}

void write_study_report(const Study& study, const std::map<int, std::string>& lines, const Summary& summary,
                        const StudyReportOptions& options, const std::filesystem::path& file) {
  const std::vector<WorstTrial> worst = pictured_trials(summary, options.pictured);
  const auto pictures = pictures_of(study, worst, options);
  write_html(file, html_report(study_page(), study_data(study, rows_of(study, lines), summary, worst, pictures)));
}

}  // namespace fringeslam::tools
