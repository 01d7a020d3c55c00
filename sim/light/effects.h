// SPDX-License-Identifier: Apache-2.0
// Switches for the simulated effects. Their parameters come from the rig or the scene; each can be disabled separately.
#pragma once

#include "core/types/options.h"

namespace fringeslam::sim {

struct Effects {
  bool vignetting = true, defocus = true, pixel_gap = true, lens_blur = true, depth_of_field = true;
  bool interreflection = true, subsurface = true, gloss = true, panes = true, relief = true, dust = true, water = true,
       air = true;
  bool motion = true, fixed_pattern = true;
  bool share_paths = true;
  int bounce_paths = 8;
  int subsurface_paths = 128;
  int exposure_steps = 4;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("vignetting", vignetting, "vignetting of the camera and projector lenses");
    v.field("defocus", defocus, "projector lens: in-focus blur and defocus");
    v.field("pixel_gap", pixel_gap, "dark gaps between projector pixels");
    v.field("lens_blur", lens_blur, "in-focus blur of the camera and thermal camera lenses");
    v.field("depth_of_field", depth_of_field, "camera lens: defocus");
    v.field("interreflection", interreflection, "light between surfaces, with the scene's number of bounces");
    v.field("subsurface", subsurface, "light below the surface of translucent materials; off: they are opaque");
    v.field("gloss", gloss, "glossy reflection of metals and coated surfaces");
    v.field("panes", panes, "reflection by panes of glass; off: they are invisible");
    v.field("relief", relief, "small-scale surface relief of materials");
    v.field("dust", dust, "settled dust");
    v.field("water", water, "water on surfaces");
    v.field("air", air, "haze");
    v.field("motion", motion, "robot motion during a stack");
    v.field("fixed_pattern", fixed_pattern, "PRNU, DSNU and dark current of the camera");
    v.field("share_paths", share_paths, "smooth indirect and scattered light over pixels that see the same surface");
    v.field("bounce_paths", bounce_paths, {1, 65536}, "paths per pixel for interreflected light");
    v.field("subsurface_paths", subsurface_paths, {2, 65536}, "paths per pixel for light below translucent surfaces");
    v.field("exposure_steps", exposure_steps, {1, 256},
            "poses per exposure during motion, at most samples_per_pixel; 1: no motion blur");
  }

  // Returns the set with all effects off.
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
