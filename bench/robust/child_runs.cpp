// SPDX-License-Identifier: Apache-2.0
#include "bench/robust/child_runs.h"

#include <sys/wait.h>

#include <cstdlib>

#include "core/base/fnv.h"
#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "tools/shell.h"

namespace fringeslam::robust {

namespace fs = std::filesystem;

namespace {

constexpr const char* kScene = R"(name: small
seed: 3
rig:
  file: rig.yaml
patterns:
  axis: columns
  steps: 3
  periods_px: [1040, 131, 16.5]
  bits: 8
light:
  ambient_lux: 290
materials:
  table: {grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}
  cardboard: {grain: cardboard, albedo: 0.55, contrast: 0.35, grain_m: 0.01}
objects:
  - {shape: plane, size_m: [0.8, 0.8], material: table}
  - shape: scatter
    count: 12
    area_m: [0.24, 0.24]
    max_height_m: 0.12
    items:
      - {shape: box, size_min_m: [0.04, 0.03, 0.02], size_max_m: [0.09, 0.08, 0.08], material: cardboard}
trajectory:
  interval_s: 0.5
  motions:
    - {translation_mm: [10, 5, -5], rotation_deg: [3, 1, -2]}
)";

constexpr const char* kMovingScene = R"(name: moving
seed: 3
rig:
  file: rig.yaml
patterns:
  axis: columns
  steps: 3
  periods_px: [1040, 131, 16.5]
light:
  ambient_lux: 60
materials:
  floor: {grain: concrete, albedo: 0.42, contrast: 0.45, grain_m: 0.05}
  stone: {grain: stone, albedo: 0.42, contrast: 0.4, grain_m: 0.03}
  cardboard: {grain: cardboard, albedo: 0.55, contrast: 0.4, grain_m: 0.04}
objects:
  - {shape: plane, size_m: [4, 4], material: floor}
  - shape: scatter
    count: 120
    area_m: [2, 2]
    max_height_m: 0.3
    items:
      - {shape: box, size_min_m: [0.12, 0.1, 0.06], size_max_m: [0.34, 0.28, 0.2], material: cardboard}
      - {shape: rock, size_min_m: [0.08, 0.07, 0.05], size_max_m: [0.28, 0.24, 0.16], material: stone}
trajectory:
  spline:
    count: 3
    waypoints:
      - {camera_m: [0, 0, 0.95], look_at_m: [0.2, 0.3, 0.05]}
      - {camera_m: [0.1, 0.05, 0.97], look_at_m: [0.25, 0.35, 0.05]}
      - {camera_m: [0.15, 0.05, 0.97], look_at_m: [0.27, 0.37, 0.05]}
  continuous: {speed_m_s: 0.3, view_rate_hz: 8}
)";

// Writes a scene, and a rig of scenes/rigs with 1 / reduction of its width and height.
void write_scene(const fs::path& folder, const char* scene, const std::string& rig_name, int reduction) {
  RigModel rig = read_rig(fs::path(FRINGESLAM_SCENES) / "rigs" / rig_name);
  Pinhole& camera = rig.camera;
  camera.width /= reduction, camera.height /= reduction;
  camera.fx /= reduction, camera.fy /= reduction;
  camera.cx = (camera.cx + 0.5) / reduction - 0.5, camera.cy = (camera.cy + 0.5) / reduction - 0.5;
  fs::create_directories(folder);
  write_text(folder / "rig.yaml", to_yaml(rig));
  write_text(folder / "scene.yaml", scene);
}

}  // namespace

std::string shell_line(const std::vector<std::string>& words) {
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : " ") + tools::quoted(word);
  return line;
}

Ended execute(const fs::path& folder, const std::string& line) {
  const fs::path printed = folder / "printed.out", messages = folder / "printed.err";
  const std::string command = "cd " + tools::quoted(folder.string()) + " && " + line + " > " +
                              tools::quoted(printed.string()) + " 2> " + tools::quoted(messages.string()) +
                              " < /dev/null";
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_bytes(printed), read_bytes(messages)};
}

Ended execute_well(const fs::path& folder, const std::string& line) {
  Ended ended = execute(folder, line);
  if (ended.exit_code != 0) throw Error("fails: " + line + ": " + ended.err);
  return ended;
}

std::map<std::string, uint64_t> content(const fs::path& folder) {
  std::map<std::string, uint64_t> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file())
      files[entry.path().lexically_relative(folder).string()] = fnv1a(read_bytes(entry.path()));
  }
  return files;
}

void write_small_scene(const fs::path& folder, int reduction) { write_scene(folder, kScene, "thesis.yaml", reduction); }

void write_moving_scene(const fs::path& folder) { write_scene(folder, kMovingScene, "wide.yaml", 2); }

}  // namespace fringeslam::robust
