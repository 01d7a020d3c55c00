// SPDX-License-Identifier: Apache-2.0
// What a trial runs: the options of pipeline and rendering, and the scene.
#pragma once

#include <string>

#include "bench/studies/study.h"
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::studies {

struct TrialSettings {
  PipelineOptions pipeline;
  sim::RenderOptions render;

  // visit(name, options) for each group of options.
  template <class Visit>
  void for_each_group(Visit&& visit) {
    pipeline.for_each_stage(visit);
    visit("render", render);
  }
};

// Whether a name, such as decode.min_modulation_dn, is of a group of options; else it is a scene's.
bool is_setting(const std::string& name);

// Throw Error.
TrialSettings settings_of(const Study& study, const Trial& trial);
sim::Scene scene_of(const Study& study, const Trial& trial);

}  // namespace fringeslam::studies
