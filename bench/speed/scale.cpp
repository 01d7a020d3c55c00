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
  const auto report =
      nlohmann::json::parse(browser_result("page_speed.mjs", "report '" + (folder / "run/report.html").string() + "'"));
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
          bound_row("scale.run.report", report.at("open_s"), 1, "s", 3, Limit::most),
          bound_row("speed.run.dataset", views / mapping_s, views, "views/s", 25, Limit::least)};
}

// Turns the map on the live page. The map of `loop` with every view as a keyframe has 0.5 GB.
std::vector<Row> live_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-live-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string dataset = "'" + (folder / "dataset").string() + "'";
  run_program("render '" FRINGESLAM_SCENES "/loop' --out " + dataset + " --set render.samples_per_pixel=1",
              folder / "render.json");
  std::vector<double> rates;
  for (int turn = 0; turn < (context.quick ? 1 : 3); ++turn) {
    const auto result =
        nlohmann::json::parse(browser_result("page_speed.mjs", "live '" FRINGESLAM_BENCH_PROGRAM "' " + dataset));
    rates.push_back(result.at("frames_per_s"));
    std::fprintf(stderr, "  %d points: %.1f frames/s\n", result.at("points").get<int>(), rates.back());
  }
  fs::remove_all(folder);
  return {median_row("scale.live", rates, "frames/s", 20, Limit::least)};
}

}  // namespace

std::vector<Item> scale_items() {
  return {
      {{"scale.run.memory", "scale.run.after", "scale.run.report", "speed.run.dataset"},
       "run over 900 recorded views: peak memory, time after mapping relative to mapping, rate of mapping, and time "
       "until its report is shown",
       run_rows,
       true},
      {{"scale.live"}, "the live page with a map of 0.5 GB: frames per second while it is turned", live_rows, true}};
}

}  // namespace fringeslam::bench
