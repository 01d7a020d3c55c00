// SPDX-License-Identifier: Apache-2.0
// The verbs of the command line. Each function adds its subcommand to the application and returns the callback that
// runs it after parsing and returns the exit code.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

namespace fringeslam::tools {

// Options common to all verbs.
struct Common {
  bool json = false;   // one JSON document on standard output, nothing else
  bool quiet = false;  // no progress
};

// Prints a verb's result: the JSON document with --json, otherwise the line unless --quiet is set.
inline void say(const Common& common, const nlohmann::ordered_json& document, const std::string& line) {
  if (common.json)
    std::printf("%s\n", document.dump(2).c_str());
  else if (!common.quiet)
    std::printf("%s\n", line.c_str());
}

using Verb = std::function<int()>;

Verb add_run(CLI::App& app, const Common& common);
Verb add_effects(CLI::App& app, const Common& common);
Verb add_render(CLI::App& app, const Common& common);
Verb add_scene(CLI::App& app, const Common& common);
Verb add_score(CLI::App& app, const Common& common);
Verb add_landmarks(CLI::App& app, const Common& common);
Verb add_info(CLI::App& app, const Common& common);
Verb add_calibrate(CLI::App& app, const Common& common);
Verb add_calibrate_rig(CLI::App& group, const Common& common);
Verb add_calibrate_response(CLI::App& group, const Common& common);
Verb add_calibrate_stage(CLI::App& group, const Common& common);
Verb add_import(CLI::App& app, const Common& common);
Verb add_study(CLI::App& app, const Common& common);
Verb add_patterns(CLI::App& app, const Common& common);
#if FRINGESLAM_REPORT
Verb add_report(CLI::App& app, const Common& common);
#endif
#if FRINGESLAM_HW
Verb add_capture(CLI::App& app, const Common& common);
Verb add_rig(CLI::App& app, const Common& common);
Verb add_rig_focus(CLI::App& group, const Common& common);
#endif

}  // namespace fringeslam::tools
