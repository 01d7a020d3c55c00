// SPDX-License-Identifier: Apache-2.0
// Gain from a study's second worker.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "bench/row.h"
#include "bench/script.h"
#include "core/io/files.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

nlohmann::json studied(const fs::path& study, int jobs, const fs::path& out) {
  const std::string answer = out.string() + ".json";
  run_program("study run '" + study.string() + "' --out '" + out.string() + "' --jobs " + std::to_string(jobs), answer);
  return nlohmann::json::parse(std::ifstream(answer));
}

// Interleaved, so that other load on the machine affects both alike.
std::vector<Row> study_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-study-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  write_text(folder / "study.yaml", "name: speed\nscene: " + fs::path(FRINGESLAM_STUDIES).string() +
                                        "/boxes_two_views.yaml\ntrials: " + std::to_string(context.quick ? 8 : 24) +
                                        "\nparameters:\n  light.ambient_lux: {log_uniform: [10, 1000]}\n");
  std::vector<double> gain, rate;
  double largest_mib = 0;
  for (int turn = 0; turn < (context.quick ? 2 : 5); ++turn) {
    const auto one = studied(folder / "study.yaml", 1, folder / ("one" + std::to_string(turn)));
    const auto two = studied(folder / "study.yaml", 2, folder / ("two" + std::to_string(turn)));
    rate.push_back(two["trials_a_second"]);
    gain.push_back(rate.back() / one["trials_a_second"].get<double>());
    largest_mib = std::max(largest_mib, two["largest_worker_mib"].get<double>());
  }
  fs::remove_all(folder);
  std::fprintf(stderr, "  two workers: %.2f trials of two views per second; largest worker %.0f MiB\n", rate.back(),
               largest_mib);
  return {median_row("speed.study", gain, "x", 1.9, Limit::least)};
}

}  // namespace

std::vector<Item> study_items() { return {{{"speed.study"}, "a study with two workers relative to one", study_rows}}; }

}  // namespace fringeslam::bench
