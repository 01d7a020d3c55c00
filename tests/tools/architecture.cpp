// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/architecture.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <regex>
#include <set>

namespace fringeslam::test {

namespace fs = std::filesystem;

namespace {

using Names = std::set<std::string>;

const Names kTops = {"core", "sim", "hw", "bench", "tools", "python"};
const Names kStages = {"core/decode",       "core/depth", "core/landmarks", "core/motion",
                       "core/registration", "core/map",   "core/thermal"};
const Names kBasics = {"core/base", "core/types", "core/patterns"};

Names operator+(Names a, const Names& b) {
  a.insert(b.begin(), b.end());
  return a;
}

// The project folders that each folder may include; a top-level name such as "core" includes all its subfolders.
const std::map<std::string, Names>& allowed_folders() {
  static const std::map<std::string, Names> allowed = [] {
    std::map<std::string, Names> table = {{"core/base", {"core/base"}},
                                          {"core/types", {"core/base", "core/types"}},
                                          {"core/patterns", kBasics},
                                          {"core/io", kBasics + Names{"core/io"}},
                                          {"core/rig", kBasics + Names{"core/io", "core/rig"}},
                                          {"core/import", kBasics + Names{"core/io", "core/rig", "core/import"}},
                                          {"core/check", kBasics + Names{"core/decode", "core/check"}},
                                          {"core/storage", kBasics + Names{"core/io", "core/landmarks", "core/map", "core/storage"}},
                                          {"core/mapper", kStages + kBasics + Names{"core/mapper"}},
                                          {"sim", kBasics + Names{"core/io", "core/rig", "sim"}},
                                          {"hw", kBasics + Names{"core/io", "core/rig", "hw"}},
                                          {"bench", {"core", "sim", "bench"}},
                                          // Its programs run the command line.
                                          {"bench/robust", {"core", "sim", "bench", "tools"}},
                                          {"python", {"core", "sim", "bench", "python"}},
                                          {"tools", {"core", "sim", "hw", "bench", "tools"}}};
    for (const std::string& stage : kStages + Names{"core/calibrate"}) table[stage] = kBasics + Names{stage};
    table["core/score"] = kBasics + Names{"core/io", "core/score"};
    return table;
  }();
  return allowed;
}

// An external library, identified by the prefix of its headers' paths.
struct Library {
  std::string prefix;
  Names folders;           // folders that may use it; empty: all
  bool in_headers = true;  // true if header files may include it
};

const std::vector<Library>& libraries() {
  static const std::vector<Library> all = {
      {"embree3/", {"sim"}, false},
      {"assimp/", {"sim"}, false},
      {"BulletCollision/", {"sim"}, false},
      {"LinearMath/", {"sim"}, false},
      {"btBullet", {"sim"}, false},
      {"ceres/", {"core/motion", "core/map", "core/registration", "core/calibrate"}, false},
      {"pcl/", {"core/registration", "bench"}, false},
      {"OpenImageIO/", {"core/io"}, false},
      {"openvdb/", {"core/map"}, false},
      {"yaml-cpp/", {}, false},
      {"arv.h", {"hw"}, false},
      {"aravis", {"hw"}, false},
      {"SDL", {"hw"}, false},
      {"hidapi", {"hw"}, false},
      {"httplib.h", {"tools"}, false},
      {"rosbag/", {"tools"}, false},
      {"ros/", {"tools"}, false},
      {"std_msgs/", {"tools"}, false},
      {"geometry_msgs/", {"tools"}, false},
      {"sensor_msgs/", {"tools"}, false},
      {"nav_msgs/", {"tools"}, false},
      {"tf2_msgs/", {"tools"}, false},
      {"pybind11/", {"python"}}};
  return all;
}

bool starts_with_any(const std::string& text, const Names& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(), [&](const std::string& p) { return text.starts_with(p); });
}

// Returns "core/depth" for core/depth/depth.h, "sim" for sim/light/effects.h.
std::string folder_of(const fs::path& file) {
  auto part = file.begin();
  const std::string top = part->string();
  if (std::distance(file.begin(), file.end()) <= 2) return top;
  const std::string below = top + "/" + (++part)->string();
  return top == "core" || allowed_folders().contains(below) ? below : top;
}

bool may_include(const std::string& folder, const std::string& other) {
  const auto entry = allowed_folders().find(folder);
  if (entry == allowed_folders().end()) return false;
  return entry->second.count(other) || entry->second.count(other.substr(0, other.find('/')));
}

bool is_standard(const std::string& included) { return included.find_first_of("/.") == std::string::npos; }

// Returns why `file` may not include the header of an external library; empty if it may.
std::string library_objection(const fs::path& file, const std::string& included) {
  const bool header = file.extension() == ".h";
  for (const Library& library : libraries()) {
    if (!included.starts_with(library.prefix)) continue;
    if (!library.folders.empty() && !library.folders.count(folder_of(file)))
      return "library not allowed in this folder";
    if (header && !library.in_headers) return "heavy library in a header";
  }
  const bool matrices = included.starts_with("Eigen/") || included.starts_with("opencv2/");
  if (header && matrices && included != "Eigen/Core" && !included.starts_with("opencv2/core"))
    return "headers may use only Eigen/Core and opencv2/core";
  if (folder_of(file) == "core/types" && !is_standard(included) &&
      !starts_with_any(included, {"Eigen/", "opencv2/core"}))
    return "core/types may use only Eigen and opencv2/core";
  return "";
}

std::string objection(const fs::path& file, const std::string& included, bool in_quotes) {
  const fs::path target(included);
  if (kTops.count(target.begin()->string()))
    return may_include(folder_of(file), folder_of(target)) ? ""
                                                           : folder_of(file) + " may not include " + folder_of(target);
  // Relative paths would hide a dependency from this scan.
  if (in_quotes) return "path not relative to the source root";
  return library_objection(file, included);
}

void scan(const fs::path& root, const fs::path& file, std::vector<std::string>& found) {
  static const std::regex kInclude(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"].*)");
  std::ifstream in(root / file);
  std::string line;
  std::smatch match;
  for (int number = 1; std::getline(in, line); ++number) {
    if (!std::regex_match(line, match, kInclude)) continue;
    const std::string why = objection(file, match[2], match[1] == "\"");
    if (!why.empty())
      found.push_back(file.generic_string() + ":" + std::to_string(number) + ": " + match[2].str() + " (" + why + ")");
  }
}

}  // namespace

std::vector<std::string> violations(const fs::path& root) {
  std::vector<fs::path> files;
  for (const std::string& top : kTops) {
    if (!fs::exists(root / top)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      const std::string kind = entry.path().extension().string();
      if (kind == ".h" || kind == ".cpp") files.push_back(fs::relative(entry.path(), root));
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<std::string> found;
  for (const fs::path& file : files) scan(root, file, found);
  return found;
}

}  // namespace fringeslam::test
