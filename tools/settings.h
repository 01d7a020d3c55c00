// SPDX-License-Identifier: Apache-2.0
// All options of a run, and `--set stage.key=value`.
#pragma once

#include <string>
#include <vector>

#include "core/map/mesh.h"
#include "core/mapper/image_tracker.h"
#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::tools {

struct Settings {
  PipelineOptions pipeline;
  sim::RenderOptions render;
  MeshOptions mesh;
  ImageTrackerOptions image_poses;

  // Calls visit(name, options) for each group of options.
  template <class Visit>
  void for_each_group(Visit&& visit) {
    pipeline.for_each_stage(visit);
    visit("render", render);
    visit("mesh", mesh);
    visit("image_poses", image_poses);
  }
};

// Parses "stage.key=value" settings. Throws Error on a malformed, unknown or out-of-range setting; for an unknown one
// the message names the nearest known one.
Settings parse_settings(const std::vector<std::string>& sets);
// True if one of the arguments of --set is of this group.
bool sets_any_of(const std::vector<std::string>& sets, const std::string& group);

std::string pipeline_yaml(Settings settings);
std::string render_yaml(Settings settings);
std::string mesh_yaml(Settings settings);
std::string image_poses_yaml(Settings settings);

// Returns one line per setting for --help: "decode.min_modulation_dn  3  least fringe amplitude …".
std::string settings_help();

// Returns docs/reference/settings.md: all settings with default, range and meaning.
std::string settings_markdown();

}  // namespace fringeslam::tools
