// SPDX-License-Identifier: Apache-2.0
// Runs over many views: memory, and the time that follows mapping.
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "bench/row.h"
#include "bench/script.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

// Maps the recorded terrain with the default outputs of `run`.
std::vector<Row> run_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-scale-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string terrain = std::string(FRINGESLAM_SCENES) + "/terrain";
  const std::string dataset = "'" + (folder / "dataset").string() + "'";
  std::fprintf(stderr, "  rendering the terrain to %s\n", dataset.c_str());
  // The scene has 900 views; the last case is another number.
  const int planned = context.quick ? 90 : context.last_case;
  const bool other = planned != Context{}.last_case;
  run_program("render '" + terrain + "' --out " + dataset +
                  (other ? " --with trajectory.spline.count=" + std::to_string(planned) : ""),
              folder / "render.json");
  run_program("run " + dataset + " --out '" + (folder / "run").string() + "'", folder / "run.json");
  const auto run = nlohmann::json::parse(std::ifstream(folder / "run.json"));
  fs::remove_all(folder);
  const int views = run.at("score").at("stacks");
  std::fprintf(stderr, "  %d views, %d tracked\n", views, run.at("score").at("tracked").get<int>());
  double mapping_s = 0, after_s = 0, peak_mib = 0;
  for (const auto& phase : run.at("phases")) {
    const std::string name = phase.at("name");
    const double seconds = phase.at("seconds");
    (name == "mapping" ? mapping_s : after_s) += seconds;
    peak_mib = phase.at("peak_mib");
    std::fprintf(stderr, "  %-10s %4.0f s, resident so far at most %5.0f MiB\n", name.c_str(), seconds, peak_mib);
  }
  return {bound_row("scale.run.memory", peak_mib / 1024, views, "GiB", 2, Limit::most),
          bound_row("scale.run.after", after_s / mapping_s, views, "x", 0.5, Limit::most),
          bound_row("speed.run.dataset", views / mapping_s, views, "views/s", 25, Limit::least)};
}

}  // namespace

std::vector<Item> scale_items() {
  return {{{"scale.run.memory", "scale.run.after", "speed.run.dataset"},
           "run over 900 recorded views: peak memory, time after mapping relative to mapping, and rate of mapping",
           run_rows,
           true}};
}

}  // namespace fringeslam::bench
