// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/spec.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/studies/trial_settings.h"
#include "core/io/yaml.h"
#include "core/patterns/design.h"
#include "core/rig/rig_file.h"
#include "sim/scene/cache.h"
#include "sim/scene/data_folder.h"

namespace fringeslam::datasets {

namespace fs = std::filesystem;

namespace {

constexpr int kMostSamples = 100'000'000;

std::vector<fs::path> read_scenes(const YamlMap& map) {
  std::vector<fs::path> files;
  for (const std::string& text : map.texts("scenes")) {
    std::error_code ignored;
    fs::path file = map.folder() / text;
    if (fs::is_directory(file, ignored)) file /= sim::kSceneFile;
    if (!fs::is_regular_file(file, ignored)) file = sim::scene_file(text);
    if (!fs::is_regular_file(file, ignored))
      throw map.error("scenes",
                      "'" + text + "' is neither a scene file or folder next to this file nor a scene's name");
    files.push_back(fs::weakly_canonical(file));
  }
  return files;
}

std::vector<fs::path> read_rigs(const YamlMap& map) {
  std::vector<fs::path> files;
  for (const fs::path& file : map.paths("rigs")) {
    std::error_code ignored;
    if (!fs::is_regular_file(file, ignored))
      throw map.error("rigs", file.string() + (fs::exists(file, ignored) ? " is not a file" : " does not exist"));
    files.push_back(fs::weakly_canonical(file));
  }
  return files;
}

Publication read_publication(const YamlMap& map) {
  Publication publication;
  publication.license = map.text("license");
  publication.url = map.text("url");
  publication.creator = map.text("creator");
  publication.date = map.text("date");
  int year = 0, month = 0, day = 0, end = 0;
  if (std::sscanf(publication.date.c_str(), "%4d-%2d-%2d%n", &year, &month, &day, &end) != 3 ||
      static_cast<size_t>(end) != publication.date.size())
    throw map.error("date", "'date' must have the form 2026-01-31");
  publication.version = map.text_or("version", publication.version);
  publication.citation = map.text_or("citation", "");
  return publication;
}

std::vector<Part> read_parts(const YamlMap& map) {
  std::vector<Part> parts;
  const std::vector<std::string> known = choice_names<Part>(), texts = map.texts("write");
  for (const std::string& text : texts) {
    const auto found = std::find(known.begin(), known.end(), text);
    if (found == known.end()) {
      const std::string nearest = nearest_name(text, known);
      std::string list;
      for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
      throw map.error("write", "'" + text + "' is not one of " + list +
                                   (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
    }
    if (std::count(texts.begin(), texts.end(), text) > 1) throw map.error("write", "'" + text + "' is listed twice");
  }
  for (const Part part : choice_values<Part>()) {
    if (std::find(texts.begin(), texts.end(), to_string(part)) != texts.end()) parts.push_back(part);
  }
  return parts;
}

void read_shares(const YamlMap& map, Spec& spec) {
  double sum = 0;
  for (size_t i = 0; i < kSplits.size(); ++i) {
    spec.shares[i] = map.number_or(kSplits[i], 0, {0, 1});
    sum += spec.shares[i];
  }
  map.finish();  // a misspelt split is reported before the sum that lacks it
  if (std::abs(sum - 1) > 1e-9) throw map.error("the shares of train, validation and test must add up to 1");
}

// Returns the number of the first world of a split.
int first_world(const Spec& spec, size_t split) {
  double share = 0;
  for (size_t i = 0; i < split; ++i) share += spec.shares[i];
  return split == kSplits.size() ? spec.worlds : static_cast<int>(std::lround(share * spec.worlds));
}

void check_split(const YamlMap& map, const Spec& spec) {
  for (size_t i = 0; i < kSplits.size(); ++i) {
    if (spec.shares[i] > 0 && first_world(spec, i) == first_world(spec, i + 1))
      throw map.error(map.has("split") ? "split" : "worlds", std::to_string(spec.worlds) + " worlds leave none for " +
                                                                 kSplits[i] + "; give more worlds, or another 'split'");
  }
}

studies::Parameter choice_among(const std::string& name, size_t count) {
  studies::Parameter parameter;
  parameter.name = name;
  parameter.law = studies::Parameter::Law::choice;
  for (size_t i = 0; i < count; ++i) parameter.values.push_back(std::to_string(i));
  return parameter;
}

int drawn_index(const Spec& spec, int trial, const std::string& name, size_t count) {
  return count == 0 ? -1 : std::stoi(studies::drawn_value(spec, trial, choice_among(name, count)));
}

// Checks that a pattern sequence can be made for a rig.
void check_patterns(const std::string& patterns, const std::string& where, const RigModel& rig) {
  const std::string name = "patterns";
  const YamlMap map = YamlMap::parse("patterns: " + patterns, name);
  try {
    const YamlMap section = map.map("patterns");
    (void)design_sequence(read_design(section, rig));
    section.boolean_or("linearised", false);
    map.finish();
  } catch (const Error& e) {
    const std::string message = e.what(), place = name + ":1: ";  // the line is that of the text above
    throw Error(where + (message.starts_with(place) ? message.substr(place.size()) : message));
  }
}

}  // namespace

std::vector<Part> default_parts() {
  std::vector<Part> parts = choice_values<Part>();
  std::erase(parts, Part::phase);
  return parts;
}

bool Spec::writes(Part part) const { return std::find(parts.begin(), parts.end(), part) != parts.end(); }

Spec read_spec(const fs::path& file) {
  const YamlMap map = YamlMap::load(file);
  Spec spec;
  spec.file = file;
  spec.name = map.text("name");
  spec.description = map.text_or("description", "");
  if (map.has("publication")) spec.publication = read_publication(map.map("publication"));
  spec.scenes = read_scenes(map);
  spec.scenes_where = map.error("scenes", "").what();
  if (map.has("rigs")) spec.rigs = read_rigs(map);
  spec.rigs_where = map.error("rigs", "").what();
  if (map.has("patterns")) {
    for (const YamlMap& entry : map.maps("patterns")) {
      std::string text;
      for (const std::string& key : entry.keys())
        text += (text.empty() ? "" : ", ") + key + ": " + studies::value_of(entry, key);
      spec.patterns.push_back("{" + text + "}");
      spec.patterns_where.emplace_back(entry.error("").what());
    }
  }
  spec.samples = map.integer("samples", {1, kMostSamples});
  spec.views = map.integer_or("views", 1, {1, 100'000});
  if (spec.samples % spec.views != 0)
    throw map.error("samples", "'samples' must be a multiple of 'views', " + std::to_string(spec.views));
  studies::read_sampling(map, spec);
  if (spec.worlds == 0) spec.worlds = spec.trials();
  if (spec.worlds > spec.trials())
    throw map.error("worlds", std::to_string(spec.samples) + " samples of " + std::to_string(spec.views) +
                                  " views use only " + std::to_string(spec.trials()) + " worlds");
  if (map.has("split")) read_shares(map.map("split"), spec);
  if (map.has("write")) {
    spec.parts = read_parts(map);
    spec.parts_where = map.error("write", "").what();
  }
  spec.samples_per_tar = map.integer_or("samples_per_tar", spec.samples_per_tar, {1, 1'000'000});
  spec.timeout_s = map.number_or("timeout_s", spec.timeout_s, {1, 86400});
  map.finish();
  check_split(map, spec);
  return spec;
}

std::string check_spec(const Spec& spec) {
  std::string identity = "seed " + std::to_string(spec.seed) + " samples " + std::to_string(spec.samples) + " views " +
                         std::to_string(spec.views) + " worlds " + std::to_string(spec.worlds) + " tar " +
                         std::to_string(spec.samples_per_tar) + " shares";
  for (const double share : spec.shares) identity += " " + to_text(share);
  for (const Part part : spec.parts) identity += std::string(" ") + to_string(part);
  for (const studies::Parameter& parameter : spec.parameters) {
    identity += "\n" + parameter.name + " " + to_string(parameter.law) + " " + to_text(parameter.a) + " " +
                to_text(parameter.b) + (parameter.whole ? " whole" : "");
    for (const std::string& value : parameter.values) identity += " | " + value;
  }
  for (const studies::Fixed& fixed : spec.fixed) identity += "\n" + fixed.name + "=" + fixed.value;
  for (const std::string& patterns : spec.patterns) identity += "\n" + patterns;

  std::vector<RigModel> rigs;
  bool thermal = false;  // one of the rigs has a thermal camera
  for (const fs::path& file : spec.rigs) {
    try {
      rigs.push_back(read_rig(file));
    } catch (const Error& e) {
      throw Error(spec.rigs_where + e.what());
    }
    identity += "\n" + to_yaml(rigs.back());
    thermal |= rigs.back().thermal.has_value();
  }
  for (size_t i = 0; i < spec.patterns.size(); ++i) {
    for (const RigModel& rig : rigs) check_patterns(spec.patterns[i], spec.patterns_where[i], rig);
  }
  // World i uses scene i, and trial i is the first one of world i.
  for (size_t i = 0; i < std::min(spec.scenes.size(), static_cast<size_t>(spec.worlds)); ++i) {
    const studies::Trial first = studies::trial_of(spec, static_cast<int>(i));
    try {
      (void)studies::settings_of(spec, first);
      std::vector<fs::path> files;
      const sim::Scene scene = scene_of(spec, first, &files);
      if (spec.rigs.empty()) {
        for (size_t p = 0; p < spec.patterns.size(); ++p)
          check_patterns(spec.patterns[p], spec.patterns_where[p], scene.rig);
      }
      if (!scene.path && scene.trajectory.size() < static_cast<size_t>(spec.views))
        throw Error("the trajectory has " + std::to_string(scene.trajectory.size()) +
                    " views, fewer than 'views' of this dataset");
      std::vector<studies::Trial> others = studies::trials_of_all_texts(spec, first);
      others.erase(others.begin());
      for (const studies::Trial& other : others) {
        try {
          (void)scene_of(spec, other, &files);
        } catch (const Error&) {
          // Listed with the samples that the simulator refuses.
        }
      }
      std::vector<fs::path> distinct;
      for (const fs::path& each : files) {
        if (std::find(distinct.begin(), distinct.end(), each) == distinct.end()) distinct.push_back(each);
      }
      // A resolved scene has the names of its meshes only.
      identity += "\n" + scene.resolved + to_yaml(scene.rig) + sim::contents_hash(distinct);
      thermal |= scene.rig.thermal.has_value();
    } catch (const Error& e) {
      // An error in a pattern sequence is reported with its line here instead of the scene's.
      RigModel any;
      any.projector.width = any.projector.height = 1024;
      for (size_t p = 0; p < spec.patterns.size(); ++p) check_patterns(spec.patterns[p], spec.patterns_where[p], any);
      studies::blame_entry(spec, e);
      throw Error(spec.scenes_where + e.what());
    }
  }
  for (const Part part : {Part::thermal, Part::temperature}) {
    if (!thermal && !spec.parts_where.empty() && spec.writes(part))
      throw Error(spec.parts_where + "'" + to_string(part) + "' needs a thermal camera, which no rig of the dataset " +
                  "has; omit it or add such a rig");
  }
  return identity;
}

int split_of(const Spec& spec, int world) {
  int split = 0;
  while (world >= first_world(spec, static_cast<size_t>(split) + 1)) ++split;
  return split;
}

std::vector<Tar> tars_of(const Spec& spec) {
  const auto trials_per_tar = static_cast<size_t>(std::max(1, spec.samples_per_tar / spec.views));
  std::array<std::vector<Tar>, kSplits.size()> by_split;
  for (int trial = 0; trial < spec.trials(); ++trial) {
    const int split = split_of(spec, studies::world_of(spec, trial));
    std::vector<Tar>& tars = by_split[static_cast<size_t>(split)];
    if (tars.empty() || tars.back().trials.size() == trials_per_tar) {
      char number[16];
      std::snprintf(number, sizeof number, "-%06zu", tars.size());
      tars.push_back({split, std::string(kSplits[static_cast<size_t>(split)]) + number, {}});
    }
    tars.back().trials.push_back(trial);
  }
  std::vector<Tar> all;
  for (std::vector<Tar>& tars : by_split) all.insert(all.end(), tars.begin(), tars.end());
  return all;
}

Selection selection_of(const Spec& spec, int trial) {
  const auto scenes = static_cast<int>(spec.scenes.size());
  return {studies::world_of(spec, trial) % scenes, drawn_index(spec, trial, "rigs", spec.rigs.size()),
          drawn_index(spec, trial, "patterns", spec.patterns.size())};
}

sim::Scene scene_of(const Spec& spec, const studies::Trial& trial, std::vector<fs::path>* files) {
  const Selection selected = selection_of(spec, trial.index);
  sim::SceneLoadOptions reading{trial.world_seed};
  reading.files = files;
  if (selected.patterns >= 0)
    reading.changes.emplace_back("patterns", spec.patterns[static_cast<size_t>(selected.patterns)]);
  for (auto& change : studies::changes_of(spec, trial, false)) reading.changes.push_back(std::move(change));
  if (selected.rig >= 0) reading.rig_file = spec.rigs[static_cast<size_t>(selected.rig)];
  return sim::load_scene(spec.scenes[static_cast<size_t>(selected.scene)], reading);
}

void check_inputs(const Spec& spec, const studies::Trial& trial) {
  const Selection selected = selection_of(spec, trial.index);
  if (selected.rig >= 0) (void)read_rig(spec.rigs[static_cast<size_t>(selected.rig)]);
  // World i uses scene i, and trial i is the first one of world i.
  (void)scene_of(spec, studies::trial_of(spec, selected.scene));
}

}  // namespace fringeslam::datasets
