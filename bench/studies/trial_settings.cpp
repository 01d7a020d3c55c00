// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/trial_settings.h"

#include "core/io/setting_groups.h"

namespace fringeslam::studies {

bool is_setting(const std::string& name) {
  bool known = false;
  TrialSettings settings;
  settings.for_each_group([&](const std::string& group, auto&) { known |= name.starts_with(group + "."); });
  return known;
}

TrialSettings settings_of(const Sampling& sampling, const Trial& trial) {
  std::vector<std::string> sets;
  for (const auto& [name, value] : changes_of(sampling, trial, true)) sets.push_back(name + "=" + value);
  TrialSettings settings;
  apply_settings(settings, sets);
  settings.render.check();
  return settings;
}

sim::Scene scene_of(const Study& study, const Trial& trial, std::vector<std::filesystem::path>* files) {
  sim::SceneLoadOptions reading{trial.world_seed};
  reading.files = files;
  reading.changes = changes_of(study, trial, false);
  return sim::load_scene(study.scene, reading);
}

}  // namespace fringeslam::studies
