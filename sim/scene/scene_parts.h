// SPDX-License-Identifier: Apache-2.0
// Parsers for the sections of a scene file (keys in scenes/README.md). Internal to the scene-reading sources.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/io/yaml.h"
#include "sim/scene/building.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

constexpr Range kLength{1e-4, 100};
constexpr Range kMillimetres{-1e5, 1e5};
constexpr Range kFraction{0, 1};

using Materials = std::map<std::string, Material>;

// Reads one entry of `materials`. Throws Error on invalid values.
Material read_material(const YamlMap& map);
// Returns the material named by the key 'material' of `map`.
Material find_material(const YamlMap& map, const Materials& materials);

// Inputs and message output of read_objects.
struct ObjectContext {
  const Materials& materials;
  uint64_t seed = 0;
  std::vector<std::string>& notes;
  SceneLimits limits = {};
  uint32_t piles = 0;  // read before
};
// Reads entry `number` of the scene's `objects`; scatters, piles and mesh files yield several objects.
std::vector<Object> read_objects(const YamlMap& entry, uint32_t number, ObjectContext& context);

// Reads the `building` section. Throws Error on invalid values, also if its rubble exceeds the limits.
Building read_building(const YamlMap& map, const Materials& materials, const SceneLimits& limits);

// Reads the `trajectory` section into the scene's trajectory, path and motion; a tour needs the scene's building. Throws
// Error on invalid values.
void read_trajectory(const YamlMap& map, const SceneLimits& limits, const std::optional<BuildingPlan>& building,
                     Scene& scene);

}  // namespace fringeslam::sim
