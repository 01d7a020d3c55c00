// SPDX-License-Identifier: Apache-2.0
// Suites: the scenes on which systems are compared. Read from YAML:
//
//   description: boxes and rubble, the robot stops for each view
//   timeout_s: 300                      most time of a system per dataset
//   memory_mib: 8192                    most memory of its processes together
//   datasets:
//     - {name: boxes, scene: ../boxes_and_foam, seeds: 5}
//     - {name: fast, scene: ../loop, seeds: 3, first_seed: 1, with: ["trajectory.continuous.speed_m_s=0.3"]}
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::evaluation {

struct SuiteDataset {
  std::string name;
  std::filesystem::path scene;
  uint64_t seed = 1;
  std::vector<std::string> with;  // changes to the scene, as in --with
};

struct Suite {
  std::string name, description;
  double timeout_s = 300;
  double memory_mib = 8192;
  std::vector<SuiteDataset> datasets;  // one for each seed
};

// Reads a suite; `suite` is a file, or the name of one of the suites in `folder`. Throws Error with file:line, or with
// the names of the suites.
Suite read_suite(const std::string& suite, const std::filesystem::path& folder);

}  // namespace fringeslam::evaluation
