// SPDX-License-Identifier: Apache-2.0
// Settings of a trial: the options of pipeline and rendering, and the scene.
#pragma once

#include <string>

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
sim::Scene scene_of(const Study& study, const Trial& trial);

}  // namespace fringeslam::studies
