// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/scene_list.h"

#include <algorithm>

#include "core/io/yaml.h"
#include "core/types/error.h"
#include "sim/scene/data_folder.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

std::string description_of(const fs::path& file) {
  try {
    return YamlMap::load(file).text_or("description", "");
  } catch (const Error& e) {
    return std::string("cannot be read: ") + e.what();
  }
}

}  // namespace

std::vector<ListedScene> list_scenes(const fs::path& folder) {
  if (!fs::is_directory(folder)) throw Error(folder.string() + ": is not a folder; give the folder of scenes by --in");
  std::vector<ListedScene> scenes;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const fs::path file = entry.path() / sim::kSceneFile;
    std::error_code unknown;  // a folder that may not be read counts as none
    if (fs::exists(file, unknown)) scenes.push_back({entry.path(), description_of(file)});
  }
  if (scenes.empty()) throw Error(folder.string() + ": contains no folder with a scene.yaml");
  std::sort(scenes.begin(), scenes.end(), [](const auto& a, const auto& b) { return a.folder < b.folder; });
  return scenes;
}

}  // namespace fringeslam::tools
