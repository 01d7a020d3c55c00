// SPDX-License-Identifier: Apache-2.0
// Variation between trials: parameters with their laws, fixed values, scene seeds. Shared by studies and
// datasets.
//
// The values of trial i are a function of the seed, i and the parameter's name only, independent of other trials, of
// their order and of the number of workers.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace fringeslam {
class Error;
class YamlMap;
}  // namespace fringeslam

namespace fringeslam::studies {

// A scene's key (light.ambient_lux) or a setting (decode.min_modulation_dn).
struct Parameter {
  enum class Law { uniform, log_uniform, normal, choice, grid };
  std::string name;
  Law law = Law::uniform;
  double a = 0, b = 0;              // bounds; or mean and sigma
  std::vector<std::string> values;  // of choice and grid
  bool whole = false;               // rounded
  bool setting = false;             // a setting of pipeline or rendering, otherwise a key of the scene
  std::string where;                // "study.yaml:7: "
  bool logarithmic() const { return law == Law::log_uniform; }
  bool numeric() const { return law != Law::choice; }
};

// Returns the law's name in study files.
std::string to_string(Parameter::Law law);

// A value common to all trials.
struct Fixed {
  std::string name, value;
  bool setting = false;
  std::string where;
};

enum class Design {
  random,   // all trials independent
  saltelli  // rows of parameters.size() + 2 trials: two independent draws A and B, and A with one parameter of B each,
            // for estimating Sobol indices (Saltelli et al. 2010)
};

struct Sampling {
  uint64_t seed = 1;
  int worlds = 0;  // number of scene seeds that trials cycle through; 0: each trial has its own
  Design design = Design::random;
  std::vector<Parameter> parameters;
  std::vector<Fixed> fixed;
};

// Reads seed, worlds, parameters and fixed, all of them optional. Throws Error with file:line.
void read_sampling(const YamlMap& map, Sampling& sampling);

// Returns a value as one line of YAML: a scalar, or a list of scalars in brackets.
std::string value_of(const YamlMap& map, const std::string& key);

// Throws `error` with the line of the parameter or fixed value that its message names; returns if it names none.
void blame_entry(const Sampling& sampling, const Error& error);

// Returns the number of trials in a row of the design; they share a scene seed.
int row_length(const Sampling& sampling);

struct Trial {
  int index = 0;
  uint64_t world_seed = 0;
  std::vector<std::string> values;  // of each parameter, YAML
};

Trial trial_of(const Sampling& sampling, int index);

// Returns the trial, and the trial with each other text of each of the scene's keys that are drawn from a list: together they
// use the files that any trial uses, unless the choice of one file depends on another key.
std::vector<Trial> trials_of_all_texts(const Sampling& sampling, const Trial& trial);

// Returns the number of a trial's world, from 0. Worlds are cycled through so that each combination of grid values meets
// all of them.
int world_of(const Sampling& sampling, int index);

// Returns the value of a parameter in a trial of a random design.
std::string drawn_value(const Sampling& sampling, int trial, const Parameter& parameter);

// Returns a trial's names and values, either those of the scene or those of the settings.
std::vector<std::pair<std::string, std::string>> changes_of(const Sampling& sampling, const Trial& trial,
                                                            bool settings);

}  // namespace fringeslam::studies
