// SPDX-License-Identifier: Apache-2.0
// A study: a scene, what of it varies and how, and when a trial counts as a success. Read from study.yaml (keys in
// README.md).
//
// What trial i draws is a function of the study's seed, i and the parameter's name: of no other trial, of no order and
// of no number of workers.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace fringeslam::studies {

// Of a scene's key (light.ambient_lux), or of a setting (decode.min_modulation_dn).
struct Parameter {
  enum class Law { uniform, log_uniform, normal, choice, grid };
  std::string name;
  Law law = Law::uniform;
  double a = 0, b = 0;              // bounds; or mean and sigma
  std::vector<std::string> values;  // of choice and grid
  bool whole = false;               // rounded
  bool setting = false;             // of the pipeline or the rendering, else of the scene
  std::string where;                // "study.yaml:7: "
  bool logarithmic() const { return law == Law::log_uniform; }
  bool numeric() const { return law != Law::choice; }
};

// A value that all trials have.
// The word of a study file.
std::string to_string(Parameter::Law law);

struct Fixed {
  std::string name, value;
  bool setting = false;
  std::string where;
};

enum class Design {
  random,   // every trial on its own
  saltelli  // rows of parameters.size() + 2 trials: two independent draws A and B, and A with one parameter of B each;
            // the numbers from which Sobol indices follow (Saltelli et al. 2010)
};

struct SuccessRule {
  double max_translation_m = 1e-3;  // of the worst motion between views that follow one another
  double max_rotation_deg = 0.1;
  double min_valid = 0;  // least share of lit pixels with a depth, of the worst view
};

struct Study {
  std::string name, description;
  std::filesystem::path file, scene;
  int trials = 0;
  uint64_t seed = 1;
  int worlds = 0;  // seeds of the scene that trials take in turn; 0: each its own
  Design design = Design::random;
  double timeout_s = 300;
  std::vector<Parameter> parameters;
  std::vector<Fixed> fixed;
  SuccessRule success;
  uint64_t hash = 0;  // of all of it, and of the scene's own file
};

// Throws Error with file:line.
Study read_study(const std::filesystem::path& file);
// Whether the names and the first trial's values are ones that scene and settings know: reads the scene. Throws Error.
void check_study(const Study& study);

// The hash as results and pages name it.
std::string hash_text(const Study& study);

// Trials in a row of the design: they share a world.
int row_length(const Study& study);

struct Trial {
  int index = 0;
  uint64_t world_seed = 0;
  std::vector<std::string> values;  // of each parameter, YAML
};

Trial trial_of(const Study& study, int index);

// Of a study's names and values, those of the scene or of the settings.
std::vector<std::pair<std::string, std::string>> changes_of(const Study& study, const Trial& trial, bool settings);

// The command that does what a trial does, and keeps all of it.
std::string command_of(const Study& study, const Trial& trial);

}  // namespace fringeslam::studies
