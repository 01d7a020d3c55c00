// SPDX-License-Identifier: Apache-2.0
// Settings of a trial: the options of pipeline and rendering, and the scene.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "bench/studies/study.h"
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::studies {

struct TrialSettings {
  PipelineOptions pipeline;
  sim::RenderOptions render;

  // Calls visit(name, options) for each group of options.
  template <class Visit>
  void for_each_group(Visit&& visit) {
    pipeline.for_each_stage(visit);
    visit("render", render);
  }
};

// True if a name such as decode.min_modulation_dn belongs to a group of options; otherwise it is a scene's key.
bool is_setting(const std::string& name);

// These throw Error for invalid values.
TrialSettings settings_of(const Sampling& sampling, const Trial& trial);
// `files` receives the files on which the scene depends, if set, as far as they are known, also if loading fails.
sim::Scene scene_of(const Study& study, const Trial& trial, std::vector<std::filesystem::path>* files = nullptr);

}  // namespace fringeslam::studies
