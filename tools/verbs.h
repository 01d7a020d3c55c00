// SPDX-License-Identifier: Apache-2.0
// The verbs of the command line. Each function adds its subcommand to the application and returns the callback that
// runs it after parsing and returns the exit code.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "core/types/options.h"
#include "tools/command_line.h"

namespace fringeslam::tools {

// Options common to all verbs.
struct Common {
  bool json = false;   // one JSON document on standard output, nothing else
  bool quiet = false;  // no progress
};

// Prints lines on standard output, without control characters. Names from files in them must be on a single_line().
void print_text(const std::string& lines);

// Prints a verb's result: the JSON document with --json, otherwise the line, like print_text(), unless --quiet is set.
void print_result(const Common& common, const nlohmann::ordered_json& document, const std::string& line);

// Adds an option whose value is one of an enum's choices.
template <NamedEnum E>
Option add_choice(Command verb, const std::string& name, E& value, const std::string& help) {
  const auto assign = [&value](const std::string& text) {
    for (const Choice<E>& choice : choices(E())) {
      if (choice.name == text) value = choice.value;
    }
  };
  return verb.add_option(name, assign, help).check_one_of(choice_names<E>());
}

using Verb = std::function<int()>;

Verb add_advise(Command app, const Common& common);
Verb add_run(Command app, const Common& common);
Verb add_map(Command app, const Common& common);
Verb add_evaluate(Command app, const Common& common);
Verb add_effects(Command app, const Common& common);
Verb add_render(Command app, const Common& common);
Verb add_scene(Command app, const Common& common);
Verb add_settings(Command app, const Common& common);
Verb add_score(Command app, const Common& common);
Verb add_decode(Command app, const Common& common);
Verb add_twin(Command app, const Common& common);
Verb add_landmarks(Command app, const Common& common);
Verb add_info(Command app, const Common& common);
Verb add_calibrate(Command app, const Common& common);
Verb add_calibrate_rig(Command group, const Common& common);
Verb add_calibrate_noise(Command group, const Common& common);
Verb add_calibrate_response(Command group, const Common& common);
Verb add_calibrate_stage(Command group, const Common& common);
Verb add_import(Command app, const Common& common);
Verb add_study(Command app, const Common& common);
Verb add_dataset(Command app, const Common& common);
Verb add_patterns(Command app, const Common& common);
#if FRINGESLAM_REPORT
Verb add_report(Command app, const Common& common);
#endif
#if FRINGESLAM_HW
Verb add_capture(Command app, const Common& common);
Verb add_rig(Command app, const Common& common);
Verb add_rig_focus(Command group, const Common& common);
#endif

}  // namespace fringeslam::tools
