// SPDX-License-Identifier: Apache-2.0
// The parts of a scene file, each read from its own section (keys in scenes/README.md). Included by the files that read
// scenes and by nobody else.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/io/yaml.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

constexpr Range kLength{1e-4, 100};
constexpr Range kMillimetres{-1e5, 1e5};
constexpr Range kFraction{0, 1};

using Materials = std::map<std::string, Material>;

Material read_material(const YamlMap& map);
// The material that `map` names by its key 'material'.
Material find_material(const YamlMap& map, const Materials& materials);

// What reading objects needs to know and may say.
struct ObjectContext {
  const Materials& materials;
  uint64_t seed = 0;
  std::vector<std::string>& notes;
  SceneLimits limits = {};
};
// One entry of `objects`, the `number`th of the scene; several objects when it scatters, piles up or imports.
std::vector<Object> read_objects(const YamlMap& entry, uint32_t number, const ObjectContext& context);

Trajectory read_trajectory(const YamlMap& map, const RigModel& rig, uint64_t seed, const SceneLimits& limits);

}  // namespace fringeslam::sim
