// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/sampling.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numeric>

#include "bench/studies/trial_settings.h"
#include "core/base/fnv.h"
#include "core/io/yaml.h"
#include "sim/random.h"

namespace fringeslam::studies {

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

bool is_number(const std::string& value) {
  double number = 0;
  const char* const end = value.data() + value.size();
  return std::from_chars(value.data(), end, number).ptr == end;
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

std::string value_of(const YamlMap& map, const std::string& key) {
  std::string list;
  const std::vector<std::string> texts = map.texts(key);
  for (const std::string& text : texts) list += (list.empty() ? "" : ", ") + text;
  // texts() takes a scalar as a list of one; as text, "key: [3]" and "key:\n  - 3" are lists, "key: -3" is not.
  const std::string text = map.dump({key}, map.folder());
  const size_t value = text.find_first_not_of(" \n", key.size() + 1);
  const bool scalar = texts.size() == 1 && text.compare(value, 1, "[") != 0 && text.compare(value, 2, "- ") != 0;
  return scalar ? list : "[" + list + "]";
}

void read_sampling(const YamlMap& map, Sampling& sampling) {
  if (map.has("seed")) sampling.seed = map.seed("seed");
  sampling.worlds = map.integer_or("worlds", 0, {0, 1'000'000});
  if (map.has("parameters")) {
    const YamlMap parameters = map.map("parameters");
    for (const std::string& name : parameters.keys()) {
      sampling.parameters.push_back(read_parameter(name, parameters.map(name)));
      sampling.parameters.back().where = parameters.error(name, "").what();
    }
  }
  if (!map.has("fixed")) return;
  const YamlMap fixed = map.map("fixed");
  for (const std::string& name : fixed.keys()) {
    const bool twice = std::any_of(sampling.parameters.begin(), sampling.parameters.end(),
                                   [&](const Parameter& p) { return p.name == name; });
    if (twice) throw fixed.error(name, "'" + name + "' is also a parameter");
    sampling.fixed.push_back({name, value_of(fixed, name), is_setting(name), fixed.error(name, "").what()});
  }
}

void blame_entry(const Sampling& sampling, const Error& error) {
  const std::string message = error.what();
  const auto says = [&](const std::string& part) { return message.find(part) != std::string::npos; };
  const auto blame_first = [&](const auto& is_named) {
    const auto blame = [&](const auto& entry) {
      if (is_named(entry.name)) throw Error(entry.where + entry.name + ": " + message);
    };
    for (const Parameter& parameter : sampling.parameters) blame(parameter);
    for (const Fixed& fixed : sampling.fixed) blame(fixed);
  };
  blame_first([&](const std::string& name) { return says("unknown key '" + name.substr(0, name.find('.')) + "'"); });
  blame_first(
      [&](const std::string& name) { return says("'" + name.substr(name.rfind('.') + 1) + "'") || says(name); });
}

std::string to_string(Parameter::Law law) {
  return std::find_if(kLaws.begin(), kLaws.end(), [&](const auto& known) { return known.second == law; })->first;
}

int row_length(const Sampling& sampling) {
  return sampling.design == Design::saltelli ? static_cast<int>(sampling.parameters.size()) + 2 : 1;
}

Trial trial_of(const Sampling& sampling, int index) {
  const int length = row_length(sampling), row = index / length, place = index % length;
  Trial trial;
  trial.index = index;
  trial.world_seed = sampling.seed * 1'000'000 + static_cast<uint64_t>(world_of(sampling, index)) + 1;
  int cell = row;
  for (size_t p = 0; p < sampling.parameters.size(); ++p) {
    const Parameter& parameter = sampling.parameters[p];
    // 0: A, 1: B, from 2 on: A with the parameter of that number from B.
    const bool from_b = place == 1 || place == static_cast<int>(p) + 2;
    if (parameter.law == Law::grid && sampling.design == Design::random) {
      const auto n = static_cast<int>(parameter.values.size());
      trial.values.push_back(parameter.values[static_cast<size_t>(cell % n)]);
      cell /= n;
    } else {
      trial.values.push_back(Draw(sampling.seed, static_cast<uint32_t>(row), from_b).value(parameter));
    }
  }
  return trial;
}

std::vector<Trial> trials_of_all_texts(const Sampling& sampling, const Trial& trial) {
  std::vector<Trial> trials = {trial};
  for (size_t p = 0; p < sampling.parameters.size(); ++p) {
    if (sampling.parameters[p].setting) continue;
    for (const std::string& value : sampling.parameters[p].values) {
      if (value == trial.values[p] || is_number(value)) continue;
      trials.push_back(trial);
      trials.back().values[p] = value;
    }
  }
  return trials;
}

int world_of(const Sampling& sampling, int index) {
  const int row = index / row_length(sampling);
  if (sampling.worlds <= 0) return row;
  if (sampling.design == Design::saltelli) return row % sampling.worlds;
  // If the numbers of combinations of grid values and of worlds have a common divisor, plain cycling would pair them in the same
  // way for ever. More combinations than trials need no shift.
  int64_t combinations = 1;
  for (const Parameter& parameter : sampling.parameters) {
    if (parameter.law == Law::grid && combinations <= row)
      combinations *= static_cast<int64_t>(parameter.values.size());
  }
  const int64_t worlds = sampling.worlds;
  const int64_t shift = std::gcd(combinations, worlds) > 1 ? row / std::lcm(combinations, worlds) : 0;
  return static_cast<int>((row + shift) % worlds);
}

std::string drawn_value(const Sampling& sampling, int trial, const Parameter& parameter) {
  return Draw(sampling.seed, static_cast<uint32_t>(trial), 0).value(parameter);
}

std::vector<std::pair<std::string, std::string>> changes_of(const Sampling& sampling, const Trial& trial,
                                                            bool settings) {
  std::vector<std::pair<std::string, std::string>> changes;
  for (const Fixed& fixed : sampling.fixed) {
    if (fixed.setting == settings) changes.emplace_back(fixed.name, fixed.value);
  }
  for (size_t p = 0; p < sampling.parameters.size(); ++p) {
    if (sampling.parameters[p].setting == settings) changes.emplace_back(sampling.parameters[p].name, trial.values[p]);
  }
  return changes;
}

}  // namespace fringeslam::studies
