// SPDX-License-Identifier: Apache-2.0
// Scenes of repetitive structure: perforated plates, tiles, printed grids, arrays of equal boxes and bars.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/types/pose.h"
#include "sim/scene/scene.h"

namespace fringeslam::bench {

struct RepeatingScene {
  std::string name;
  double period_m = 0;
  sim::Scene scene;  // without trajectory
};

int repeating_scene_count();

// Builds scene `number`, 0 <= number < repeating_scene_count().
RepeatingScene repeating_scene(int number);

// Returns world_from_camera of cameras that look down at the middle of the structure, shifted against each other by up
// to 1.5 periods, tilted and turned.
std::vector<Pose> cameras_above(const RepeatingScene& repeating, int count, uint64_t seed);

}  // namespace fringeslam::bench
