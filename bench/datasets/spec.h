// SPDX-License-Identifier: Apache-2.0
// A dataset: scenes, rigs, patterns, what varies in them and how, and what is written. Read from a YAML file (keys in
// README.md).
//
// A trial is a scene with drawn values, as in a study; it yields `views` consecutive samples. Trials cycle through the
// worlds, and all trials of a world belong to the same split. Samples are written to tar files that contain whole
// trials of one split. All of this follows from the file alone.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/studies/sampling.h"
#include "core/types/options.h"
#include "sim/virtual_rig.h"

namespace fringeslam::datasets {

// Parts of a sample; the calibration, the patterns, the poses and the drawn values always belong to it.
enum class Part { images, thermal, depth, normals, coordinate, phase, order, sigma, objects, mask, temperature };

constexpr auto choices(Part) {
  using enum Part;
  return std::to_array<Choice<Part>>({{images, "images"},
                                      {thermal, "thermal"},
                                      {depth, "depth"},
                                      {normals, "normals"},
                                      {coordinate, "coordinate"},
                                      {phase, "phase"},
                                      {order, "order"},
                                      {sigma, "sigma"},
                                      {objects, "objects"},
                                      {mask, "mask"},
                                      {temperature, "temperature"}});
}

// Returns all parts but the phase, which follows from the coordinate and takes as much space.
std::vector<Part> default_parts();

constexpr std::array<const char*, 3> kSplits = {"train", "validation", "test"};

// Information that catalogs of datasets require.
struct Publication {
  std::string license, url, creator, date, version = "1.0.0", citation;
};

struct Spec : studies::Sampling {
  std::filesystem::path file;
  std::string name, description;
  std::optional<Publication> publication;
  std::vector<std::filesystem::path> scenes;          // world w uses the scene w modulo their number
  std::vector<std::filesystem::path> rigs;            // one is drawn for each trial; empty: the scene's
  std::vector<std::string> patterns;                  // likewise; a scene's section `patterns` as one line of YAML
  std::string scenes_where, rigs_where, parts_where;  // "dataset.yaml:3: "; parts_where: empty without `write`
  std::vector<std::string> patterns_where;
  int samples = 0, views = 1, samples_per_tar = 100;
  std::array<double, kSplits.size()> shares = {0.8, 0.1, 0.1};
  std::vector<Part> parts = default_parts();
  double timeout_s = 600;  // per trial

  int trials() const { return samples / views; }
  bool writes(Part part) const;
};

// Reads a specification. Throws Error with file:line.
Spec read_spec(const std::filesystem::path& file);

// Loads the first trial of each scene, and each rig and pattern sequence. Throws Error with file:line. Returns a text
// that determines the bytes of all samples, apart from the program's version.
std::string check_spec(const Spec& spec);

// Returns the index in kSplits of a world's split: the first worlds are for training, the last ones for tests. Worlds are
// independent, so their order has no meaning.
int split_of(const Spec& spec, int world);

struct Tar {
  int split = 0;
  std::string name;  // "train-000000"
  std::vector<int> trials;
};
// Returns all tar files, by split and number.
std::vector<Tar> tars_of(const Spec& spec);

// The rig and patterns of a trial; -1: those of the scene.
struct Selection {
  int scene = 0, rig = -1, patterns = -1;
};
Selection selection_of(const Spec& spec, int trial);

// Loads the scene of a trial; `files` receives those on which it depends. Throws Error if the drawn values are invalid.
sim::Scene scene_of(const Spec& spec, const studies::Trial& trial, std::vector<std::filesystem::path>* files = nullptr);

// Loads the rig of a trial, and the first trial of its scene: throws Error if a file that the trial needs cannot be read,
// whatever values were drawn for it.
void check_inputs(const Spec& spec, const studies::Trial& trial);

}  // namespace fringeslam::datasets
