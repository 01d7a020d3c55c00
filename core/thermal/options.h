// SPDX-License-Identifier: Apache-2.0
// What makes a warm region a victim's skin, or something else.
#pragma once

#include "core/types/options.h"

namespace fringeslam {

struct ThermalOptions {
  double hidden_by_m = 0.03;
  double surroundings_quantile = 0.3;
  double min_contrast_k = 2.5;
  double coldest_c = 24, hottest_c = 39.5;
  double halo_px = 3;
  double core_contrast = 0.55, rim_px = 2;
  double step_m = 0.006, crease_radius_m = 0.02;
  double min_area_m2 = 0.0012, max_area_m2 = 0.12;
  double plane_angle_deg = 8, plane_distance_m = 0.001, max_planar_share = 0.7;
  double pipe_distance_m = 0.001, pipe_share = 0.85, min_pipe_length = 0.5, max_pipe_radius_m = 0.035;
  double same_place_m = 0.05, overlap_m = 0.02;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("hidden_by_m", hidden_by_m, {1e-4, 10},
            "a point that lies so much farther than another in the thermal camera's pixel is not seen by it");
    v.field("surroundings_quantile", surroundings_quantile, {0, 1},
            "of the view's temperatures, the one that counts as that of the surroundings");
    v.field("min_contrast_k", min_contrast_k, {0.01, 100}, "warm is what exceeds the surroundings by as much");
    v.field("coldest_c", coldest_c, {-50, 100}, "skin: least apparent temperature of a region's warmest fifth");
    v.field("hottest_c", hottest_c, {-50, 400}, "skin: greatest apparent temperature of a region's warmest fifth");
    v.field("halo_px", halo_px, {0, 50},
            "so many pixels of the thermal camera beside anything hotter than that nothing is judged");
    v.field("core_contrast", core_contrast, {0, 1},
            "of a region's contrast, what its core has: the rest is the blur of its rim");
    v.field(
        "rim_px", rim_px, {0, 50},
        "farther from the core, in pixels of the thermal camera, what is less warm is another thing that touches it");
    v.field("step_m", step_m, {1e-4, 1}, "a step in depth, from a pixel to the next, that ends a region");
    v.field("crease_radius_m", crease_radius_m, {1e-4, 1}, "a hollow of a smaller radius ends a region");
    v.field("min_area_m2", min_area_m2, {0, 10}, "smallest region of skin");
    v.field("max_area_m2", max_area_m2, {0, 100}, "largest region of skin");
    v.field("plane_angle_deg", plane_angle_deg, {0.1, 90}, "flat: most that a normal deviates from its plane's");
    v.field("plane_distance_m", plane_distance_m, {1e-5, 1}, "flat: farthest that a point lies from its plane");
    v.field("max_planar_share", max_planar_share, {0, 1}, "flat: when more of a region lies on two planes");
    v.field("pipe_distance_m", pipe_distance_m, {1e-5, 1}, "pipe: farthest that a point lies from the cylinder");
    v.field("pipe_share", pipe_share, {0, 1}, "pipe: when so much of a region lies on one cylinder");
    v.field("min_pipe_length", min_pipe_length, {0, 100}, "pipe: least length over its visible width");
    v.field("max_pipe_radius_m", max_pipe_radius_m, {1e-4, 10}, "pipe: greatest radius");
    v.field("same_place_m", same_place_m, {1e-4, 10}, "regions of skin so near to each other are of one victim");
    v.field("overlap_m", overlap_m, {1e-4, 10},
            "regions of several views are one when half of the smaller one's points lie so near to the other");
  }
};

}  // namespace fringeslam
