// SPDX-License-Identifier: Apache-2.0
// What a person would want to know of a scene before mapping it: whether the rig stands in something, sees anything, in
// its beam and its range, and enough of what it saw before.
#pragma once

#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

// One view of the trajectory; shares of the camera's pixels.
struct ViewCheck {
  double surface = 0;   // see a surface
  double lit = 0;       // that the projector lights
  double in_range = 0;  // and that lies within the rig's near_m and far_m
  double overlap = 0;   // of what the view before saw lit, is in this view; 1 for the first
  bool inside = false;  // the camera stands within an object
  std::string object;   // which
};

struct SceneCheck {
  std::vector<ViewCheck> views;
  std::vector<std::string> warnings;  // one line each
};

SceneCheck check_scene(const Scene& scene);

}  // namespace fringeslam::sim
