// SPDX-License-Identifier: Apache-2.0
// A study: a scene, what varies in it and how, and when a trial is a success. Read from study.yaml (keys in README.md).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>

#include "bench/studies/sampling.h"

namespace fringeslam::studies {

struct SuccessRule {
  double max_translation_m = 1e-3;  // of the worst motion between consecutive views
  double max_rotation_deg = 0.1;
  // In the worst view: smallest fraction of lit pixels with depth; largest median of their absolute depth errors, and of
  // the fractions with a wrong fringe order and with an error of more than four sigmas.
  double min_valid = 0;
  double max_depth_m = 10, max_wrong_order = 1, max_beyond_4_sigma = 1;
};

struct Study : Sampling {
  std::string name, description;
  std::filesystem::path file, scene;
  int trials = 0;
  double timeout_s = 300;
  int views = 0;  // most views of a trial; 0: to the end of the scene
  SuccessRule success;
  uint64_t hash = 0;       // of the study's file and of the scene's file
  std::string files_hash;  // set by hash_files()
};

// Columns of the results beside parameters and metrics.
inline constexpr std::array kOwnColumns = {"trial", "seed", "outcome", "cause", "message"};

// Reads a study. Throws Error with file:line.
Study read_study(const std::filesystem::path& file);
// Sets the hash of the files on which the scene depends, which results repeat: those that its files name, and those that the
// scene of the first trial reads, such as the textures of a mesh. Loads that scene; if this fails, the files that are known
// count.
void hash_files(Study& study);
// Checks the names and the first trial's values against the scene and the settings. Reads the scene. Throws Error.
void check_study(const Study& study);

// Returns the hash in the form used in results and pages.
std::string hash_text(const Study& study);

// Returns the command that repeats a trial and keeps all files.
std::string command_of(const Study& study, const Trial& trial);

}  // namespace fringeslam::studies
