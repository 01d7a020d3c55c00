// SPDX-License-Identifier: Apache-2.0
// rig.yaml <-> RigModel and patterns.yaml <-> PatternSequence. The keys are documented in
// core/rig/README.md. Writing and reading again gives the same numbers to the last bit.
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

// The `patterns:` section of a scene, and what `fringeslam patterns` reads.
SequenceDesign read_design(const YamlMap& map, const RigModel& rig);

PatternSequence read_patterns(const std::filesystem::path& file);
std::string to_yaml(const PatternSequence& sequence);

// True when some point of the working range lies in the view of the camera and in the beam of the
// projector: no scene can be measured otherwise.
bool beam_meets_view(const RigModel& rig);

}  // namespace fringeslam
