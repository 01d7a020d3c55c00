// SPDX-License-Identifier: Apache-2.0
// Conversion of rig.yaml <-> RigModel and patterns.yaml <-> PatternSequence. The keys are documented in
// core/rig/README.md. Writing and reading back preserves all numbers exactly.
#pragma once

#include <filesystem>
#include <string>

#include "core/patterns/design.h"
#include "core/types/rig_model.h"

namespace fringeslam {

class YamlMap;

RigModel read_rig(const std::filesystem::path& file);
RigModel read_rig(const YamlMap& map);
std::string to_yaml(const RigModel& rig);

// Reads the `patterns:` section of a scene.
SequenceDesign read_design(const YamlMap& map, const RigModel& rig);

PatternSequence read_patterns(const std::filesystem::path& file);
std::string to_yaml(const PatternSequence& sequence);

// Returns `rig` with the lenses, relative pose, response and phase correction of a calibration; its noise, timing, mount
// and working range remain. Throws Error if the image sizes differ.
RigModel with_calibration(RigModel rig, const RigModel& calibration);

// True if some point of the working range is in the fields of view of both camera and projector; otherwise nothing can
// be measured.
bool fields_overlap(const RigModel& rig);

}  // namespace fringeslam
