// SPDX-License-Identifier: Apache-2.0
// What the simulator may leave out. Each effect is described by the rig or the scene, and can be switched off alone.
#pragma once

#include "core/types/options.h"

namespace fringeslam::sim {

struct Effects {
  bool vignetting = true, defocus = true, pixel_gap = true, lens_blur = true, depth_of_field = true;
  bool interreflection = true, gloss = true, relief = true, dust = true, air = true;
  bool motion = true, fixed_pattern = true;
  bool share_paths = true;
  int bounce_paths = 8;
  int exposure_steps = 1;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("vignetting", vignetting, "lenses darken towards the edge");
    v.field("defocus", defocus, "projector lens: its blur, and what is out of its focus");
    v.field("pixel_gap", pixel_gap, "dark gaps between projector pixels");
    v.field("lens_blur", lens_blur, "camera lens: its blur in focus");
    v.field("depth_of_field", depth_of_field, "camera lens: what is out of its focus");
    v.field("interreflection", interreflection, "light between surfaces, as often as the scene says");
    v.field("gloss", gloss, "glossy lobes of metals and coats");
    v.field("relief", relief, "small relief of materials");
    v.field("dust", dust, "settled dust");
    v.field("air", air, "haze");
    v.field("motion", motion, "motion of the robot while a stack is taken");
    v.field("fixed_pattern", fixed_pattern, "nonuniformities and dark current of the camera's pixels");
    v.field("share_paths", share_paths,
            "light over other surfaces and out of the air is smoothed over pixels that see one surface");
    v.field("bounce_paths", bounce_paths, {1, 65536}, "paths a pixel of interreflected light");
    v.field("exposure_steps", exposure_steps, {1, 256}, "poses within an exposure, when moving; 1: no motion blur");
  }

  // All of them off.
  static Effects none() {
    struct Off {
      void field(const char*, bool& effect, const char*) { effect = false; }
      void field(const char*, int&, Range, const char*) {}
    } off;
    Effects effects;
    effects.describe(off);
    return effects;
  }
};

}  // namespace fringeslam::sim
