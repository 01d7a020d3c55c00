// SPDX-License-Identifier: Apache-2.0
// Datasets of an evaluation: rendered once, kept in the cache, with the ground truth in a folder of its own.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "bench/evaluation/suite_file.h"
#include "core/types/trajectory.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

enum class DatasetFormat { fringes, tum_rgbd, euroc, rosbag };

constexpr auto choices(DatasetFormat) {
  using enum DatasetFormat;
  return std::to_array<Choice<DatasetFormat>>(
      {{fringes, "fringes"}, {tum_rgbd, "tum-rgbd"}, {euroc, "euroc"}, {rosbag, "rosbag"}});
}

struct EvaluationDataset {
  std::string hash;               // of the scene, the format and the program
  std::filesystem::path dataset;  // what a system sees: a folder; for rosbag a file
  std::filesystem::path truth;    // for read_map_truth()
  Trajectory poses;               // true poses: of the robot for fringes, of the camera for the other formats
};

// Returns the dataset from the cache, or renders it; empty if interrupted.
std::optional<EvaluationDataset> evaluation_dataset(const evaluation::SuiteDataset& wanted, DatasetFormat format,
                                                    const Common& common);

}  // namespace fringeslam::tools
