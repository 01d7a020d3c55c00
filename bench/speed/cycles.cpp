// SPDX-License-Identifier: Apache-2.0
// The same scene, camera and fringes in Blender's Cycles: direct light, equal samples, the same number of threads.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "bench/speed/rubble.h"
#include "core/io/files.h"
#include "core/types/error.h"
#include "sim/scene/mesh_export.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

Json matrix(const Pose& pose) {
  Json rows = Json::array();
  for (int i = 0; i < 3; ++i)
    rows.push_back({pose.rotation(i, 0), pose.rotation(i, 1), pose.rotation(i, 2), pose.translation[i]});
  rows.push_back({0, 0, 0, 1});
  return rows;
}

std::vector<Row> cycles_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  const Pose camera = scene.trajectory.front().world_from_robot * scene.rig.robot_from_camera;
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-cycles-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  sim::export_mesh(scene, folder / "scene.glb");
  const int images = context.quick ? 2 : 9;
  const Json view = {{"size", {scene.rig.camera.width, scene.rig.camera.height}},
                     {"samples", 4},
                     {"threads", cv::getNumThreads()},
                     {"images", images},
                     {"period_px", 16.5},
                     {"camera", {{"fx", scene.rig.camera.fx}, {"world_from_device", matrix(camera)}}},
                     {"projector",
                      {{"fx", scene.rig.projector.fx},
                       {"world_from_device", matrix(camera * scene.rig.projector_from_camera.inverse())}}}};
  write_text(folder / "view.json", view.dump());
  const std::string command = std::string(FRINGESLAM_BENCH_SCRIPTS) + "/cycles.sh " + folder.string();
  if (std::system(command.c_str()) != 0) throw Error("cycles.sh printed no result; see its message above");
  const auto theirs = Json::parse(std::ifstream(folder / "seconds.json")).get<std::vector<double>>();
  if (const char* keep = std::getenv("FRINGESLAM_KEEP"); keep) fs::copy(folder, keep, fs::copy_options::recursive);
  fs::remove_all(folder);

  sim::RenderOptions direct;
  direct.effects = sim::Effects::none();
  Stack three(scene, 3, direct, false), nine(scene, 9, direct, false);
  const auto ours = interleaved_times({[&] { three(); }, [&] { nine(); }}, static_cast<int>(theirs.size()));
  std::fprintf(stderr, "  Cycles %.2f s per image; ours %.3f s for three, %.3f s for nine, including camera noise\n",
               median(theirs), median(ours[0]), median(ours[1]));
  std::vector<double> ratio3, ratio9;
  for (size_t i = 0; i < theirs.size(); ++i) {
    ratio3.push_back(3 * theirs[i] / ours[0][i]);
    ratio9.push_back(9 * theirs[i] / ours[1][i]);
  }
  return {median_row("speed.cycles.three", ratio3, "x", 30, Limit::least),
          median_row("speed.cycles.nine", ratio9, "x", 90, Limit::least)};
}

}  // namespace

std::vector<Item> cycles_items() {
  return {{{"speed.cycles.three", "speed.cycles.nine"},
           "three and nine images relative to Blender's Cycles (installs Blender)",
           cycles_rows,
           true}};
}

}  // namespace fringeslam::bench
