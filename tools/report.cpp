// SPDX-License-Identifier: Apache-2.0
// fringeslam report RUN
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/types/error.h"
#include "tools/output_file.h"
#include "tools/report/html_report.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

Verb add_report(Command app, const Common& common) {
  struct ReportArguments {
    std::string run, out;
  };
  auto arguments = std::make_shared<ReportArguments>();
  const Command verb =
      app.add_subcommand("report", "Write the report of a run as a single HTML file that also works offline");
  verb.add_option("run", arguments->run, "Run folder").required();
  verb.add_option("--out", arguments->out, "File to write (default: RUN/report.html)");
  return [arguments, &common] {
    const fs::path run = arguments->run;
    if (!fs::is_directory(run)) throw Error(run.string() + ": is not a run folder");
    const fs::path out = arguments->out.empty() ? run / "report.html" : fs::path(arguments->out);
    require_extension(out, ".html");
    std::vector<fs::path> inputs;
    for (const auto& entry : fs::recursive_directory_iterator(run, fs::directory_options::skip_permission_denied)) {
      if (lower_extension(entry.path()) != ".html") inputs.push_back(entry.path());
    }
    require_not_an_input(out, inputs);
    write_report(run, out);
    print_result(common, {{"report", out.string()}, {"bytes", fs::file_size(out)}}, "written: " + out.string());
    return 0;
  };
}

}  // namespace fringeslam::tools
