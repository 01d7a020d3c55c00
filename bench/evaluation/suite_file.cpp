// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/suite_file.h"

#include <algorithm>

#include "core/io/yaml.h"

namespace fringeslam::evaluation {

namespace fs = std::filesystem;

namespace {

std::string names_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem());
  }
  std::sort(names.begin(), names.end());
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

fs::path file_of(const std::string& suite, const fs::path& folder) {
  std::error_code ignored;
  if (fs::is_regular_file(suite, ignored)) return suite;
  const fs::path known = folder / (suite + ".yaml");
  if (suite.find('/') == std::string::npos && fs::is_regular_file(known, ignored)) return known;
  const std::string names = names_in(folder);
  if (names.empty())
    throw Error(suite + ": is not a suite file, and no suites are installed; set FRINGESLAM_DATA to the folder that " +
                "contains scenes/");
  throw Error(suite + ": is neither a suite file nor one of the suites " + names);
}

bool is_file_name(const std::string& name) {
  return !name.empty() && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-'; });
}

}  // namespace

Suite read_suite(const std::string& suite, const fs::path& folder) {
  const fs::path file = file_of(suite, folder);
  const YamlMap map = YamlMap::load(file);
  Suite result;
  result.name = file.stem();
  result.description = map.text_or("description", "");
  result.timeout_s = map.number_or("timeout_s", result.timeout_s, {0.1, 1e6});
  result.memory_mib = map.number_or("memory_mib", result.memory_mib, {1, 1e7});
  for (const YamlMap& entry : map.maps("datasets")) {
    SuiteDataset dataset;
    const std::string name = entry.text("name");
    if (!is_file_name(name)) throw entry.error("name", "'name' must consist of letters, digits, _ and -");
    dataset.scene = entry.path("scene");
    if (entry.has("with")) dataset.with = entry.texts("with");
    const int first = entry.integer_or("first_seed", 1, {0, 1e9});
    const int seeds = entry.integer_or("seeds", 1, {1, 1000});
    entry.finish();
    for (int i = 0; i < seeds; ++i) {
      dataset.seed = static_cast<uint64_t>(first + i);
      dataset.name = name + "-" + std::to_string(dataset.seed);
      const auto same = [&](const SuiteDataset& other) { return other.name == dataset.name; };
      if (std::any_of(result.datasets.begin(), result.datasets.end(), same))
        throw entry.error("name", "the dataset '" + dataset.name + "' occurs twice; choose another name");
      result.datasets.push_back(dataset);
    }
  }
  map.finish();
  if (result.datasets.empty()) throw map.error("datasets", "'datasets' is empty; add one");
  return result;
}

}  // namespace fringeslam::evaluation
