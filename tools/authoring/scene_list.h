// SPDX-License-Identifier: Apache-2.0
// The scenes of a folder.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::tools {

struct ListedScene {
  std::filesystem::path folder;
  std::string description;  // or why its file cannot be read
};

// Returns the scenes in the subfolders of a folder, by name. Throws Error if it is no folder or contains none.
std::vector<ListedScene> list_scenes(const std::filesystem::path& folder);

}  // namespace fringeslam::tools
