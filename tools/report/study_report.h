// SPDX-License-Identifier: Apache-2.0
// report.html of a study.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/studies/summary.h"

namespace fringeslam::tools {

struct StudyReportOptions {
  int pictured = 6;                         // trials that are run again for their pictures
  int jobs = 1;                             // of them at a time
  std::vector<std::string> picture_worker;  // command of a worker that answers with trial_pictures()
  std::function<bool()> stop = [] { return false; };
};

// Runs trials again, each in a process of its own: by trial what trial_pictures() tells, or in `unpictured` why there
// is nothing to see. Those that took too long in the study are not tried again.
std::map<int, nlohmann::ordered_json> pictures_of(const studies::Study& study,
                                                  const std::vector<studies::WorstTrial>& trials,
                                                  const StudyReportOptions& options);

// Writes the page, whole or not at all. `lines`: merged results.
void write_study_report(const studies::Study& study, const std::map<int, std::string>& lines,
                        const studies::Summary& summary, const StudyReportOptions& options,
                        const std::filesystem::path& file);

}  // namespace fringeslam::tools
