// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/study.h"

#include <algorithm>
#include <cstdio>
#include <set>

#include "bench/studies/trial_settings.h"
#include "core/base/fnv.h"
#include "core/base/shell.h"
#include "core/io/files.h"
#include "core/io/yaml.h"
#include "sim/scene/cache.h"
#include "sim/scene/scene_files.h"

namespace fringeslam::studies {

namespace fs = std::filesystem;

namespace {

void read_success(const YamlMap& map, SuccessRule& rule) {
  rule.max_translation_m = 1e-3 * map.number_or("max_translation_mm", 1e3 * rule.max_translation_m, {0, 1e4});
  rule.max_rotation_deg = map.number_or("max_rotation_deg", rule.max_rotation_deg, {0, 180});
  rule.min_valid = map.number_or("min_valid", rule.min_valid, {0, 1});
  rule.max_depth_m = 1e-3 * map.number_or("max_depth_mm", 1e3 * rule.max_depth_m, {0, 1e4});
  rule.max_wrong_order = map.number_or("max_wrong_order", rule.max_wrong_order, {0, 1});
  rule.max_beyond_4_sigma = map.number_or("max_beyond_4_sigma", rule.max_beyond_4_sigma, {0, 1});
}

fs::path scene_file(const YamlMap& map) {
  const fs::path scene = map.path("scene");
  std::error_code ignored;
  const fs::path file = fs::is_directory(scene, ignored) ? scene / "scene.yaml" : scene;
  if (!fs::is_regular_file(file, ignored)) throw map.error("scene", file.string() + " does not exist");
  return fs::weakly_canonical(file);
}

}  // namespace

Study read_study(const fs::path& file) {
  const YamlMap map = YamlMap::load(file);
  Study study;
  study.file = file;
  study.name = map.text("name");
  study.description = map.text_or("description", "");
  study.scene = scene_file(map);
  study.trials = map.integer("trials", {1, 10'000'000});
  if (map.has("design") && map.choice("design", {"random", "saltelli"}) == "saltelli") study.design = Design::saltelli;
  study.timeout_s = map.number_or("timeout_s", study.timeout_s, {1, 86400});
  study.views = map.integer_or("views", 0, {0, 1'000'000});
  if (map.has("success")) read_success(map.map("success"), study.success);
  if (!map.has("parameters")) (void)map.map("parameters");  // throws
  read_sampling(map, study);
  if (study.parameters.empty()) throw map.error("parameters", "a study needs at least one parameter");
  map.finish();
  if (study.trials % row_length(study) != 0)
    throw map.error("trials", "a saltelli design has rows of " + std::to_string(row_length(study)) +
                                  " trials; make their number a multiple of that");
  study.hash = fnv1a(read_bytes(file) + '\0' + read_bytes(study.scene));
  return study;
}

void hash_files(Study& study) {
  std::vector<fs::path> files = sim::named_files(study.scene), read;
  for (const Trial& trial : trials_of_all_texts(study, trial_of(study, 0))) {
    try {
      (void)scene_of(study, trial, &read);
    } catch (const Error&) {
      // check_study() reports it, or the trials that use it.
    }
  }
  study.files_hash = sim::contents_hash(files);
  // Their order must not depend on the folders of a machine.
  std::set<std::string> others;
  for (const fs::path& file : std::set<fs::path>(read.begin(), read.end())) {
    if (std::find(files.begin(), files.end(), file) == files.end())
      others.insert(file.filename().string() + " " + sim::contents_hash({file}) + "\n");
  }
  if (others.empty()) return;
  std::string all = study.files_hash + "\n";
  for (const std::string& other : others) all += other;
  study.files_hash = sim::content_hash(all);
}

void check_study(const Study& study) {
  for (const Parameter& parameter : study.parameters) {
    if (std::find(kOwnColumns.begin(), kOwnColumns.end(), parameter.name) != kOwnColumns.end())
      throw Error(study.file.string() + ": parameters: '" + parameter.name +
                  "' is a column of each study's results and cannot be varied; remove it");
  }
  const Trial first = trial_of(study, 0);
  try {
    (void)settings_of(study, first);
    (void)scene_of(study, first);
  } catch (const Error& e) {
    blame_entry(study, e);
    throw;
  }
}

std::string hash_text(const Study& study) {
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(study.hash));
  return hash;
}

std::string command_of(const Study& study, const Trial& trial) {
  std::string command =
      "fringeslam run " + quoted(study.scene.string()) + " --seed " + std::to_string(trial.world_seed);
  if (study.views > 0) command += " --views " + std::to_string(study.views);
  for (const bool settings : {false, true}) {
    for (const auto& [name, value] : changes_of(study, trial, settings))
      command += (settings ? " --set " : " --with ") + quoted(name + "=" + value);
  }
  return command;
}

}  // namespace fringeslam::studies
