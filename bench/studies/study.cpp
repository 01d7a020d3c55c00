// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/study.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>

#include "bench/studies/trial_settings.h"
#include "core/base/fnv.h"
#include "core/io/files.h"
#include "core/io/yaml.h"
#include "sim/random.h"

namespace fringeslam::studies {

namespace fs = std::filesystem;

namespace {

using Law = Parameter::Law;

constexpr std::array<std::pair<const char*, Law>, 5> kLaws = {{{"uniform", Law::uniform},
                                                               {"log_uniform", Law::log_uniform},
                                                               {"normal", Law::normal},
                                                               {"choice", Law::choice},
                                                               {"grid", Law::grid}}};

Parameter read_parameter(const std::string& name, const YamlMap& map) {
  Parameter parameter;
  parameter.name = name;
  parameter.setting = is_setting(name);
  std::string law;
  for (const auto& [word, which] : kLaws) {
    if (!map.has(word)) continue;
    if (!law.empty()) throw map.error(word, "'" + law + "' and '" + word + "': use only one of the two");
    law = word;
    parameter.law = which;
  }
  if (law.empty()) throw map.error("'" + name + "' needs uniform, log_uniform, normal, choice or grid");
  if (parameter.law == Law::choice || parameter.law == Law::grid) {
    parameter.values = map.texts(law);
    return parameter;
  }
  parameter.whole = map.boolean_or("whole", false);
  const std::vector<double> numbers = map.numbers(law, 2, {-1e12, 1e12});
  parameter.a = numbers[0], parameter.b = numbers[1];
  if (parameter.law == Law::normal ? parameter.b < 0 : parameter.b < parameter.a)
    throw map.error(law, parameter.law == Law::normal ? "sigma must not be negative" : "put the smaller number first");
  if (parameter.law == Law::log_uniform && parameter.a <= 0) throw map.error(law, "the bounds must be above 0");
  return parameter;
}

void read_success(const YamlMap& map, SuccessRule& rule) {
  rule.max_translation_m = 1e-3 * map.number_or("max_translation_mm", 1e3 * rule.max_translation_m, {0, 1e4});
  rule.max_rotation_deg = map.number_or("max_rotation_deg", rule.max_rotation_deg, {0, 180});
  rule.min_valid = map.number_or("min_valid", rule.min_valid, {0, 1});
}

fs::path scene_file(const YamlMap& map) {
  const fs::path scene = map.path("scene");
  std::error_code ignored;
  const fs::path file = fs::is_directory(scene, ignored) ? scene / "scene.yaml" : scene;
  if (!fs::is_regular_file(file, ignored)) throw map.error("scene", file.string() + " does not exist");
  return fs::weakly_canonical(file);
}

// Returns a value as one line of YAML.
std::string value_of(const YamlMap& map, const std::string& key) {
  std::string list;
  const std::vector<std::string> texts = map.texts(key);
  for (const std::string& text : texts) list += (list.empty() ? "" : ", ") + text;
  return texts.size() == 1 ? list : "[" + list + "]";
}

// The draws of a trial, in which one parameter may come from another trial.
class Draw {
 public:
  Draw(uint64_t seed, uint32_t row, uint32_t column) : seed_(seed), row_(row), column_(column) {}

  std::string value(const Parameter& parameter) const {
    const uint64_t address = fnv1a(parameter.name);
    const sim::Philox numbers(seed_ ^ address, sim::Stream::draws, row_, column_);
    const double u = numbers.uniforms(0)[0];
    const auto text = [&](double drawn) { return to_text(parameter.whole ? std::round(drawn) : drawn); };
    switch (parameter.law) {
      case Law::uniform:
        return text(parameter.a + u * (parameter.b - parameter.a));
      case Law::log_uniform:
        return text(parameter.a * std::pow(parameter.b / parameter.a, u));
      case Law::normal:
        return text(parameter.a + parameter.b * numbers.normal_pair(1).first);
      case Law::choice:
      case Law::grid:
        break;
    }
    const auto n = static_cast<double>(parameter.values.size());
    return parameter.values[static_cast<size_t>(std::min(n - 1, std::floor(n * u)))];
  }

 private:
  uint64_t seed_;
  uint32_t row_, column_;
};

}  // namespace

Study read_study(const fs::path& file) {
  const YamlMap map = YamlMap::load(file);
  Study study;
  study.file = file;
  study.name = map.text("name");
  study.description = map.text_or("description", "");
  study.scene = scene_file(map);
  study.trials = map.integer("trials", {1, 10'000'000});
  if (map.has("seed")) study.seed = map.seed("seed");
  study.worlds = map.integer_or("worlds", 0, {0, 1'000'000});
  if (map.has("design") && map.choice("design", {"random", "saltelli"}) == "saltelli") study.design = Design::saltelli;
  study.timeout_s = map.number_or("timeout_s", study.timeout_s, {1, 86400});
  study.views = map.integer_or("views", 0, {0, 1'000'000});
  if (map.has("success")) read_success(map.map("success"), study.success);
  const YamlMap parameters = map.map("parameters");
  for (const std::string& name : parameters.keys()) {
    study.parameters.push_back(read_parameter(name, parameters.map(name)));
    study.parameters.back().where = parameters.error(name, "").what();
  }
  if (study.parameters.empty()) throw map.error("parameters", "a study needs at least one parameter");
  if (map.has("fixed")) {
    const YamlMap fixed = map.map("fixed");
    for (const std::string& name : fixed.keys()) {
      const bool twice = std::any_of(study.parameters.begin(), study.parameters.end(),
                                     [&](const Parameter& p) { return p.name == name; });
      if (twice) throw fixed.error(name, "'" + name + "' is also a parameter");
      study.fixed.push_back({name, value_of(fixed, name), is_setting(name), fixed.error(name, "").what()});
    }
  }
  map.finish();
  if (study.trials % row_length(study) != 0)
    throw map.error("trials", "a saltelli design has rows of " + std::to_string(row_length(study)) +
                                  " trials; make their number a multiple of that");
  study.hash = fnv1a(read_bytes(file) + '\0' + read_bytes(study.scene));
  return study;
}

void check_study(const Study& study) {
  const Trial first = trial_of(study, 0);
  try {
    (void)settings_of(study, first);
    (void)scene_of(study, first);
  } catch (const Error& e) {
    // Locate the line of the entry named in the message.
    const std::string message = e.what();
    const auto blame = [&](const std::string& name, const std::string& where) {
      const std::string key = name.substr(name.rfind('.') + 1);
      if (message.find("'" + key + "'") != std::string::npos || message.find(name) != std::string::npos)
        throw Error(where + name + ": " + message);
    };
    for (const Parameter& parameter : study.parameters) blame(parameter.name, parameter.where);
    for (const Fixed& fixed : study.fixed) blame(fixed.name, fixed.where);
    throw;
  }
}

std::string to_string(Parameter::Law law) {
  return std::find_if(kLaws.begin(), kLaws.end(), [&](const auto& known) { return known.second == law; })->first;
}

std::string hash_text(const Study& study) {
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(study.hash));
  return hash;
}

int row_length(const Study& study) {
  return study.design == Design::saltelli ? static_cast<int>(study.parameters.size()) + 2 : 1;
}

Trial trial_of(const Study& study, int index) {
  const int length = row_length(study), row = index / length, place = index % length;
  Trial trial;
  trial.index = index;
  const auto world = static_cast<uint32_t>(study.worlds > 0 ? row % study.worlds : row);
  trial.world_seed = study.seed * 1'000'000 + world + 1;
  int cell = row;
  for (size_t p = 0; p < study.parameters.size(); ++p) {
    const Parameter& parameter = study.parameters[p];
    // 0: A, 1: B, from 2 on: A with the parameter of that number from B.
    const bool from_b = place == 1 || place == static_cast<int>(p) + 2;
    if (parameter.law == Law::grid && study.design == Design::random) {
      const auto n = static_cast<int>(parameter.values.size());
      trial.values.push_back(parameter.values[static_cast<size_t>(cell % n)]);
      cell /= n;
    } else {
      trial.values.push_back(Draw(study.seed, static_cast<uint32_t>(row), from_b).value(parameter));
    }
  }
  return trial;
}

std::vector<std::pair<std::string, std::string>> changes_of(const Study& study, const Trial& trial, bool settings) {
  std::vector<std::pair<std::string, std::string>> changes;
  for (const Fixed& fixed : study.fixed) {
    if (fixed.setting == settings) changes.emplace_back(fixed.name, fixed.value);
  }
  for (size_t p = 0; p < study.parameters.size(); ++p) {
    if (study.parameters[p].setting == settings) changes.emplace_back(study.parameters[p].name, trial.values[p]);
  }
  return changes;
}

std::string command_of(const Study& study, const Trial& trial) {
  std::string command = "fringeslam run '" + study.scene.string() + "' --seed " + std::to_string(trial.world_seed);
  for (const bool settings : {false, true}) {
    for (const auto& [name, value] : changes_of(study, trial, settings))
      command += std::string(settings ? " --set '" : " --with '") + name + "=" + value + "'";
  }
  return command;
}

}  // namespace fringeslam::studies
