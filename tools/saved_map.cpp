// SPDX-License-Identifier: Apache-2.0
#include "tools/saved_map.h"

#include <cstdio>

#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
#include "core/types/error.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

fs::path map_file(const std::string& name) {
  const bool folder = fs::is_directory(name);
  const fs::path file = folder ? fs::path(name) / kMapFile : fs::path(name);
  if (fs::exists(file)) return file;
  // A run that died leaves no folder.
  const fs::path run = file.filename() == kMapFile && file.has_parent_path() ? file.parent_path() : fs::path(name);
  for (const LeftMap& left : left_maps(run)) throw Error(name + ": does not exist, but " + left.message);
  if (!folder) throw Error(name + ": does not exist; give a map file, or a run folder with " + kMapFile);
  throw Error(name + ": contains no " + std::string(kMapFile) +
              "; write it with `run --save-map`, or give the map file");
}

void report_left_maps(const fs::path& target) {
  for (const LeftMap& left : left_maps(target)) std::fprintf(stderr, "%s\n", left.message.c_str());
}

}  // namespace fringeslam::tools
