// SPDX-License-Identifier: Apache-2.0
// Studies for tests.
#pragma once

#include "bench/studies/study.h"
#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "tests/tools/child.h"

namespace fringeslam::test {

constexpr const char* kSmallStudy = R"(name: small
scene: scene.yaml
trials: 6
seed: 5
worlds: 2
parameters:
  light.ambient_lux: {log_uniform: [10, 5000]}
  decode.min_modulation_dn: {grid: [2, 4]}
fixed:
  objects.1.count: 6
success: {max_translation_mm: 5, max_rotation_deg: 1}
)";

// A small scene with a low-resolution sensor, and a study of it with one text replaced.
inline std::filesystem::path write_study(const std::filesystem::path& folder, const std::string& text = kSmallStudy) {
  write_small_scene(folder);
  write_bytes(folder / "rig.yaml", to_yaml(thesis_rig_reduced(4)));
  write_bytes(folder / "study.yaml", text);
  return folder / "study.yaml";
}

}  // namespace fringeslam::test
