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
  int pictured = 6;                // trials run again to get their pictures
  studies::WorkerOptions workers;  // their command answers with trial_pictures()
  std::function<bool()> stop = [] { return false; };
};

// Writes the page atomically. `lines` are the merged results. Throws Error if interrupted.
void write_study_report(const studies::Study& study, const std::map<int, std::string>& lines,
                        const studies::Summary& summary, const StudyReportOptions& options,
                        const std::filesystem::path& file);

}  // namespace fringeslam::tools
