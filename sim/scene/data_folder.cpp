// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/data_folder.h"

#include <dlfcn.h>

#include <cstdlib>

namespace fringeslam::sim {

namespace fs = std::filesystem;

namespace {

bool has_scenes(const fs::path& folder) {
  std::error_code ignored;
  return fs::is_directory(folder / "scenes" / "suites", ignored);
}

// The file that contains this function: the library, or the program or module into which it is linked.
fs::path this_binary() {
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&this_binary), &info) == 0 || !info.dli_fname) return {};
  std::error_code ignored;
  const fs::path binary = fs::canonical(info.dli_fname, ignored);
  return ignored ? fs::canonical("/proc/self/exe", ignored) : binary;
}

}  // namespace

fs::path data_folder() {
  if (const char* given = std::getenv("FRINGESLAM_DATA"); given && *given) return given;
  for (fs::path folder = this_binary().parent_path(); folder.has_relative_path(); folder = folder.parent_path()) {
    for (const fs::path& candidate : {folder / "share" / "fringeslam", folder}) {
      if (has_scenes(candidate)) return candidate;
    }
  }
  return {};
}

fs::path scene_file(const fs::path& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return path / kSceneFile;
  if (fs::exists(path, ignored) || path.has_parent_path()) return path;
  const fs::path data = data_folder();
  const fs::path known = data / "scenes" / path / kSceneFile;
  return !data.empty() && fs::is_regular_file(known, ignored) ? known : path;
}

}  // namespace fringeslam::sim
