// SPDX-License-Identifier: Apache-2.0
// report.html of a study.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>

#include "bench/studies/summary.h"
#include "bench/studies/workers.h"

namespace fringeslam::tools {

struct StudyReportOptions {
  int pictured = 6;                // trials that are run again for their pictures
  studies::WorkerOptions workers;  // that answer with trial_pictures()
  std::function<bool()> stop = [] { return false; };
};

// Writes the page, whole or not at all. `lines`: merged results. Throws Error when it was stopped.
void write_study_report(const studies::Study& study, const std::map<int, std::string>& lines,
                        const studies::Summary& summary, const StudyReportOptions& options,
                        const std::filesystem::path& file);

}  // namespace fringeslam::tools
