// SPDX-License-Identifier: Apache-2.0
// Dataset specifications for tests.
#pragma once

#include <filesystem>
#include <string>

#include "tests/studies/study_files.h"

namespace fringeslam::test {

// Twelve samples: six trials of three worlds, two views each, in three tar files.
constexpr const char* kSmallDataset = R"(name: small
description: Boxes, for tests
scenes: [scene.yaml]
samples: 12
views: 2
worlds: 3
seed: 5
samples_per_tar: 4
split: {train: 0.67, validation: 0, test: 0.33}
patterns:
  - {axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}
  - {axis: columns, steps: 4, periods_px: [131], gray: plain}
parameters:
  light.ambient_lux: {log_uniform: [10, 1000]}
fixed:
  objects.1.count: 6
)";

// Writes the small scene with a low-resolution sensor, and a specification; returns its file.
inline std::filesystem::path write_dataset(const std::filesystem::path& folder,
                                           const std::string& text = kSmallDataset) {
  write_small_scene(folder);
  write_bytes(folder / "rig.yaml", to_yaml(thesis_rig_reduced(4)));
  write_bytes(folder / "dataset.yaml", text);
  return folder / "dataset.yaml";
}

}  // namespace fringeslam::test
