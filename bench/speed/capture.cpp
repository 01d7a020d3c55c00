// SPDX-License-Identifier: Apache-2.0
// Cost of the hardware backend: a capture through a real window and GigE Vision traffic, from a camera that sees a
// simulated scene (tools/closed-loop), compared with the simulator alone rendering the same images.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "bench/row.h"
#include "core/io/files.h"
#include "core/patterns/patterns.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

Json from_closed_loop(const fs::path& folder, const std::string& verb) {
  const fs::path scripts = FRINGESLAM_BENCH_SCRIPTS, project = scripts.parent_path().parent_path();
  const std::string command = project / "tools/closed-loop", scene = fs::path(FRINGESLAM_SCENES) / "boxes_and_foam";
  const std::string program = project / "build/release/tools/fringeslam", answer = folder / "answer.json";
  if (std::system(
          ("'" + command + "' '" + scene + "' '" + program + "' " + verb + " --json > '" + answer + "'").c_str()))
    throw Error("tools/closed-loop printed no result; see its message above");
  return Json::parse(std::ifstream(answer));
}

std::vector<Row> capture_rows(const Context& context) {
  const sim::Scene scene = sim::load_scene(fs::path(FRINGESLAM_SCENES) / "boxes_and_foam/scene.yaml");
  const int width = scene.rig.projector.width, height = scene.rig.projector.height;
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-capture-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string rig_file = folder / "rig.yaml";
  write_text(rig_file, to_yaml(scene.rig) + "hardware: {settle_s: 0.01}\n");
  const int stacks = context.quick ? 2 : 10;
  const Json captured =
      from_closed_loop(folder, "capture --rig '" + rig_file + "' --out '" + (folder / "data").string() + "' --count " +
                                   std::to_string(stacks));
  const Json seen = from_closed_loop(folder, "rig latency --rig '" + rig_file + "'");
  fs::remove_all(folder);

  sim::RenderOptions options;
  options.noise = false;
  sim::VirtualRig simulator(scene, options);
  std::vector<double> look_s;
  for (int i = 0; i < 5 * stacks; ++i) {
    const Clock::time_point start = Clock::now();
    (void)simulator.look(cv::Mat1b(height, width, static_cast<uchar>(25 * (i % 10))), 0, scene.rig.timing.exposure_s,
                         i);
    look_s.push_back(seconds_since(start));
  }
  std::nth_element(look_s.begin(), look_s.begin() + look_s.size() / 2, look_s.end());
  const double own_s = look_s[look_s.size() / 2];

  constexpr int kImages = 9 + 2;  // of the default sequence, with white and black
  const double image_s = captured["stack_s"].get<double>() / kImages;
  std::fprintf(stderr,
               "  %.1f ms per image through window and packets, %.1f ms of it the simulator's; settles in %.1f ms\n",
               1e3 * image_s, 1e3 * own_s, 1e3 * seen["largest_delay_s"].get<double>());
  return {
      bound_row("speed.capture", 1 / image_s, stacks * kImages, "images/s", 5, Limit::least),
      bound_row("speed.capture.overhead", 1e3 * (image_s - own_s), stacks * kImages, "ms an image", 100, Limit::most),
      bound_row("speed.capture.latency", 1e3 * seen["largest_delay_s"].get<double>(), 10, "ms", 50, Limit::most)};
}

}  // namespace

std::vector<Item> capture_items() {
  if (!FRINGESLAM_HW) return {};
  return {{{"speed.capture", "speed.capture.overhead", "speed.capture.latency"},
           "capture through a real window and a camera's packets",
           capture_rows}};
}

}  // namespace fringeslam::bench
