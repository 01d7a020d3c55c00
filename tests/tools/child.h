// SPDX-License-Identifier: Apache-2.0
// Runs the program as a child process; provides a small test scene.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/temp_folder.h"
#include "tests/tools/fake_rig.h"
#include "tools/shell.h"

namespace fringeslam::test {

struct Finished {
  int exit_code = -1;  // 128 + signal if killed by a signal
  std::string out, err;
};

using tools::quoted;

inline Finished run_program(const std::vector<std::string>& arguments) {
  const TempFolder temp;
  std::string command = "cd " + quoted(temp.path().string()) + " && " + quoted(FRINGESLAM_PROGRAM);
  for (const std::string& argument : arguments) command += " " + quoted(argument);
  command += " > .out 2> .err < /dev/null";
  const int status = std::system(command.c_str());
  Finished finished{WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_bytes(temp / ".out"),
                    read_bytes(temp / ".err")};
  return finished;
}

// Runs the program and expects success.
inline Finished run_successfully(const std::vector<std::string>& arguments) {
  Finished finished = run_program(arguments);
  EXPECT_EQ(finished.exit_code, 0) << arguments.front() << ": " << finished.err;
  return finished;
}

// Returns a shell command that limits the size of files, which acts like a full disk; in bash in KiB, in sh in half KiB.
// The counters of a coverage build, which the limit would truncate, are written to the folder `counters` instead of their own.
inline std::string limit_file_size(int blocks, const std::string& counters) {
  return "export GCOV_PREFIX=" + quoted(counters) + "; ulimit -f " + std::to_string(blocks) + "; ";
}

// A floor and a few textured boxes in front of the thesis rig with a quarter of its pixels; two poses.
constexpr const char* kSmallScene = R"(name: small
description: Two views of a few boxes, for the command line tests
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

inline void write_small_scene(const fs::path& folder) {
  write_bytes(folder / "scene.yaml", kSmallScene);
  write_bytes(folder / "rig.yaml", to_yaml(thesis_rig_reduced(2)));
}

}  // namespace fringeslam::test
