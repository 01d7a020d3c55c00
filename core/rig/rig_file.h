// SPDX-License-Identifier: Apache-2.0
// Conversion of rig.yaml <-> RigModel and patterns.yaml <-> PatternSequence. The keys are documented in
// core/rig/README.md. Writing and reading back preserves all numbers exactly.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/patterns/design.h"
#include "core/types/rig_model.h"

namespace fringeslam {

class YamlMap;

RigModel read_rig(const std::filesystem::path& file);
RigModel read_rig(const YamlMap& map);
std::string to_yaml(const RigModel& rig);

// Reads a response: light (0 to 1) at equally spaced levels, under `table_key`, or a power law under `gamma`. Empty if
// there is neither. Throws Error unless it increases strictly.
std::vector<double> read_response(const YamlMap& map, const char* table_key);

// Reads the `patterns:` section of a scene.
SequenceDesign read_design(const YamlMap& map, const RigModel& rig);

PatternSequence read_patterns(const std::filesystem::path& file);
PatternSequence read_patterns(const YamlMap& map);
std::string to_yaml(const PatternSequence& sequence);

// Returns `rig` with the lenses and relative pose of a calibration, and with its response and phase correction if it has
// any; its noise, timing, mount and working range remain. Throws Error if the image sizes differ.
RigModel with_calibration(RigModel rig, const RigModel& calibration);

// True if some point of the working range is in the fields of view of both camera and projector; otherwise nothing can
// be measured.
bool fields_overlap(const RigModel& rig);

}  // namespace fringeslam
