// SPDX-License-Identifier: Apache-2.0
// Plausibility check of a scene before mapping: reports views whose camera is inside an object, sees too little lit or
// in-range surface, or overlaps too little with the previous view.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

// One view of the trajectory; shares are fractions of the camera's pixels unless noted.
struct ViewCheck {
  double surface = 0;   // share that sees a surface
  double lit = 0;       // share that sees a surface lit by the projector
  double in_range = 0;  // share that is lit and between the rig's near_m and far_m
  double overlap = 0;   // share of the previous view's lit points that project into this image; 1 for the first view
  bool inside = false;  // the camera is inside an object
  std::string object;   // name of that object
};

struct SceneCheck {
  std::vector<ViewCheck> views;
  std::vector<std::string> warnings;  // one line each
};

// Renders the ground truth of all views and evaluates them. `checked` is called after each view.
SceneCheck check_scene(const Scene& scene, const std::function<void()>& checked = {});

}  // namespace fringeslam::sim
