// SPDX-License-Identifier: Apache-2.0
// A study: a scene, what varies in it and how, and when a trial is a success. Read from study.yaml (keys in README.md).
//
// The values of trial i are a function of the study's seed, i and the parameter's name only, independent of other
// trials, of their order and of the number of workers.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

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

// A value common to all trials.
// Returns the law's name in study files.
std::string to_string(Parameter::Law law);

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

struct SuccessRule {
  double max_translation_m = 1e-3;  // of the worst motion between consecutive views
  double max_rotation_deg = 0.1;
  double min_valid = 0;  // smallest fraction of lit pixels with depth, in the worst view
};

struct Study {
  std::string name, description;
  std::filesystem::path file, scene;
  int trials = 0;
  uint64_t seed = 1;
  int worlds = 0;  // number of scene seeds that trials cycle through; 0: each trial has its own
  Design design = Design::random;
  double timeout_s = 300;
  int views = 0;  // most views of a trial; 0: to the end of the scene
  std::vector<Parameter> parameters;
  std::vector<Fixed> fixed;
  SuccessRule success;
  uint64_t hash = 0;  // of the study and of the scene's file
};

// Reads a study. Throws Error with file:line.
Study read_study(const std::filesystem::path& file);
// Checks the names and the first trial's values against the scene and the settings. Reads the scene. Throws Error.
void check_study(const Study& study);

// Returns the hash in the form used in results and pages.
std::string hash_text(const Study& study);

// Returns the number of trials in a row of the design; they share a scene seed.
int row_length(const Study& study);

struct Trial {
  int index = 0;
  uint64_t world_seed = 0;
  std::vector<std::string> values;  // of each parameter, YAML
};

Trial trial_of(const Study& study, int index);

// Returns a trial's names and values, either those of the scene or those of the settings.
std::vector<std::pair<std::string, std::string>> changes_of(const Study& study, const Trial& trial, bool settings);

// Returns the command that repeats a trial and keeps all files.
std::string command_of(const Study& study, const Trial& trial);

}  // namespace fringeslam::studies
