// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/placed_file.h"

#include <algorithm>
#include <cmath>
#include <regex>
#include <utility>
#include <vector>

#include "core/io/input_file.h"
#include "core/io/staged.h"
#include "core/io/yaml.h"

namespace fringeslam::tools {

namespace {

namespace fs = std::filesystem;

constexpr size_t kMostPlacedBytes = 1 << 20;
// The first line marks files that may be replaced.
const std::string kPlacedHead =
    "# Written by `fringeslam scene open`: positions of what was dragged, by key path.\n"
    "# Entries may be edited or deleted. Paths count the entries of the lists in the scene from 0.\n";

using PlacedEntries = std::vector<std::pair<std::string, std::string>>;

// Empty if there is no file.
PlacedEntries placed_entries(const fs::path& file) {
  std::error_code ignored;
  if (!fs::exists(fs::symlink_status(file, ignored))) return {};
  const std::string text = read_input(file, kMostPlacedBytes);
  if (!text.starts_with(kPlacedHead.substr(0, kPlacedHead.find('\n'))))
    throw Error(file.string() + ": was not written by this program; rename it, so that positions can be stored here");
  const YamlMap map = YamlMap::parse(text, file.string());
  if (!map.has("placed")) throw Error(file.string() + ": has no section 'placed'; delete the file to start anew");
  for (const std::string& key : map.keys()) {
    if (key != "placed")
      throw map.error(key, "'" + key + "' would be lost, since this file is written anew; move it to the scene's file");
  }
  const YamlMap placed = map.map("placed");
  PlacedEntries entries;
  for (const std::string& path : placed.keys()) entries.emplace_back(path, placed.yaml(path));
  return entries;
}

void write_entries(const fs::path& file, const PlacedEntries& entries) {
  std::string text = kPlacedHead + (entries.empty() ? "placed: {}\n" : "placed:\n");
  for (const auto& [path, value] : entries) text += "  " + path + ": " + value + "\n";
  write_text(file, text);
}

}  // namespace

bool is_position(const std::string& path) {
  constexpr size_t kLongest = 200;  // std::regex needs stack in proportion
  static const std::regex pattern(
      R"(objects\.\d+\.pose\.translation_m|trajectory\.(start|(\w+\.)?\w+\.\d+)\.(camera_m|translation_m))");
  return path.size() <= kLongest && std::regex_match(path, pattern);
}

void place(const fs::path& folder, const std::string& path, const Eigen::Vector3d& position_m) {
  constexpr double kFarthestPlace_m = 1e4, kSteps_per_m = 1e4;
  if (!is_position(path)) throw Error(path + ": is not the position of an object, a view or a waypoint");
  if (!position_m.allFinite() || position_m.cwiseAbs().maxCoeff() > kFarthestPlace_m)
    throw Error(path + ": the position must lie within 10 km of the origin");
  const fs::path file = folder / kPlacedFile;
  PlacedEntries entries = placed_entries(file);
  std::string value = "[";
  for (int i = 0; i < 3; ++i)
    value += (i > 0 ? ", " : "") + to_text(std::round(kSteps_per_m * position_m[i]) / kSteps_per_m + 0.0);
  value += "]";
  const auto found =
      std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.first == path; });
  if (found == entries.end())
    entries.emplace_back(path, value);
  else
    found->second = value;
  write_entries(file, entries);
}

void create_placed(const fs::path& folder) {
  const fs::path file = folder / kPlacedFile;
  const PlacedEntries entries = placed_entries(file);
  std::error_code ignored;
  if (!fs::exists(file, ignored)) write_entries(file, entries);
}

}  // namespace fringeslam::tools
