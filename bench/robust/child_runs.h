// SPDX-License-Identifier: Apache-2.0
// Runs the program as a child process on a small scene, for rows and tests that compare what it writes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace fringeslam::robust {

struct Ended {
  int exit_code = 0;  // 128 + signal if a signal ended it
  std::string out, err;
};

// Returns the words as a line of a POSIX shell.
std::string shell_line(const std::vector<std::string>& words);

// Runs a line of a POSIX shell in `folder`, where it keeps what the program prints.
Ended execute(const std::filesystem::path& folder, const std::string& line);

// Runs the line; throws Error with what the program printed if it fails.
Ended execute_well(const std::filesystem::path& folder, const std::string& line);

// Returns the hash of each file in a folder, by relative name; none if the folder does not exist.
std::map<std::string, uint64_t> content(const std::filesystem::path& folder);

// Writes scene.yaml, two views of a few boxes, and rig.yaml, the thesis rig with 1 / reduction of its width and height.
void write_small_scene(const std::filesystem::path& folder, int reduction);

// Writes scene.yaml, rubble under a robot in continuous motion, and rig.yaml, the wide rig with half its width and height.
void write_moving_scene(const std::filesystem::path& folder);

}  // namespace fringeslam::robust
