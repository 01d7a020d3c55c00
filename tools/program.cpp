// SPDX-License-Identifier: Apache-2.0
#include "tools/program.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <thread>
#include <vector>

#include "core/base/malloc_config.h"
#include "core/base/opencv_config.h"
#include "core/io/image_worker.h"
#include "core/types/options.h"
#include "core/types/selected_instruction_set.h"
#include "tools/process.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

// Throws Error naming the unknown verb; the parser only reports that a subcommand is required.
void refuse_unknown_verb(Command root, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  const std::string word = argv[1];
  std::vector<std::string> verbs;
  for (const Command& verb : root.subcommands()) verbs.push_back(verb.get_name());
  if (std::find(verbs.begin(), verbs.end(), word) != verbs.end()) return;
  const std::string nearest = nearest_name(word, verbs);
  throw Error("unknown verb '" + word + "'" +
              (nearest.empty() ? "; see fringeslam --help" : "; did you mean '" + nearest + "'?"));
}

}  // namespace

int run_program(int argc, char** argv) {
  prepare_process();
  keep_freed_memory();
  use_portable_opencv();
  CommandLine line("fringeslam",
                   "FringeSLAM: 3D visual SLAM with a structured-light sensor, scored against exact ground truth",
                   "fringeslam " FRINGESLAM_VERSION);
  const Command root = line.root();
  root.require_subcommand(1);
  Common common;
  int threads = 0;
  root.add_flag("--json", common.json, "Print one JSON document and nothing else");
  root.add_flag("--quiet", common.quiet, "Print no progress");
  root.add_option("--threads", threads, "Number of threads (0: all processors); results do not depend on it")
      .check_range(0, 1024);

  std::vector<std::pair<Command, Verb>> verbs;
  std::vector<Verb (*)(Command, const Common&)> adders = {
      add_run,      add_render, add_effects,   add_scene,  add_score,   add_settings,
      add_info,     add_map,    add_landmarks, add_decode, add_advise,  add_twin,
      add_patterns, add_import, add_calibrate, add_study,  add_dataset, add_evaluate};
#if FRINGESLAM_REPORT
  adders.push_back(add_report);
#endif
#if FRINGESLAM_HW
  adders.insert(adders.end(), {add_capture, add_rig});
#endif
  for (const auto add : adders) {
    Verb verb = add(root, common);
    verbs.emplace_back(root.subcommands().back(), std::move(verb));
  }
  try {
    refuse_unknown_verb(root, argc, argv);
    if (const std::optional<int> exit_code = line.parse(argc, argv)) {
      finish_standard_output();
      return *exit_code;
    }
    (void)selected_instruction_set();  // reports a wrong choice before anything is written
    prepare_image_decoding();          // while there are no threads
    // TBB does not start more, and prints warnings when asked to.
    const int most = std::max(256, 2 * static_cast<int>(std::thread::hardware_concurrency()));
    cv::setNumThreads(threads > 0 ? std::min(threads, most) : -1);
    for (const auto& [subcommand, verb] : verbs) {
      if (!subcommand.parsed()) continue;
      const int exit_code = verb();
      finish_standard_output();
      return exit_code;
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fringeslam: %s\n", message_of(e).c_str());
    return 2;
  }
  return 2;
}

}  // namespace fringeslam::tools
