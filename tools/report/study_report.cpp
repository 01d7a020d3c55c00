// SPDX-License-Identifier: Apache-2.0
#include "tools/report/study_report.h"

#include "bench/studies/rows.h"
#include "tools/report/html_report.h"
#include "tools/report/picture_workers.h"
#include "tools/report/report_page.h"
#include "tools/report/study_data.h"

namespace fringeslam::tools {

using namespace studies;

void write_study_report(const Study& study, const std::map<int, std::string>& lines, const Summary& summary,
                        const StudyReportOptions& options, const std::filesystem::path& file) {
  const std::vector<WorstTrial> worst = pictured_trials(summary, options.pictured);
  const auto pictures = pictures_of(study, worst, options.workers, options.stop);
  write_html(file, html_report(study_page(), study_data(study, rows_of(study, lines), summary, worst, pictures)));
}

}  // namespace fringeslam::tools
