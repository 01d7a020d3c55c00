// SPDX-License-Identifier: Apache-2.0
// Thresholds for the classification of warm regions as skin of a victim or other objects.
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
            "a point this much farther away than another one in the same thermal pixel is occluded, m");
    v.field("surroundings_quantile", surroundings_quantile, {0, 1},
            "quantile of the view's temperatures that defines the temperature of the surroundings");
    v.field("min_contrast_k", min_contrast_k, {0.01, 100}, "least excess over the surroundings of a warm pixel, K");
    v.field("coldest_c", coldest_c, {-50, 100},
            "skin: least apparent temperature (80th percentile of the region), degrees C");
    v.field("hottest_c", hottest_c, {-50, 400},
            "skin: greatest apparent temperature (80th percentile of the region), degrees C");
    v.field("halo_px", halo_px, {0, 50},
            "pixels within this distance of anything hotter than hottest_c are ignored, thermal pixels");
    v.field("core_contrast", core_contrast, {0, 1},
            "least share of a region's contrast in its core; pixels below it are rim, due to blur");
    v.field("rim_px", rim_px, {0, 50},
            "less warm pixels farther than this from the core belong to another object, thermal pixels");
    v.field("step_m", step_m, {1e-4, 1}, "depth step between adjacent pixels that ends a region, m");
    v.field("crease_radius_m", crease_radius_m, {1e-4, 1}, "a concave crease of a smaller radius ends a region, m");
    v.field("min_area_m2", min_area_m2, {0, 10}, "skin: smallest area of a region, m^2");
    v.field("max_area_m2", max_area_m2, {0, 100}, "skin: largest area of a region, m^2");
    v.field("plane_angle_deg", plane_angle_deg, {0.1, 90},
            "flat: largest angle between a point's normal and its plane's, degrees");
    v.field("plane_distance_m", plane_distance_m, {1e-5, 1}, "flat: largest distance of a point from its plane, m");
    v.field("max_planar_share", max_planar_share, {0, 1},
            "flat: share of a region on two planes above which it is flat");
    v.field("pipe_distance_m", pipe_distance_m, {1e-5, 1}, "pipe: largest distance of a point from the cylinder, m");
    v.field("pipe_share", pipe_share, {0, 1}, "pipe: share of a region on one cylinder above which it is a pipe");
    v.field("min_pipe_length", min_pipe_length, {0, 100}, "pipe: least ratio of length to visible width");
    v.field("max_pipe_radius_m", max_pipe_radius_m, {1e-4, 10}, "pipe: largest radius, m");
    v.field("same_place_m", same_place_m, {1e-4, 10}, "regions of skin within this distance belong to one victim, m");
    v.field("overlap_m", overlap_m, {1e-4, 10},
            "regions of different views are merged if half of the smaller one's points are this near to the other, at "
            "least the spacing of these points, m");
  }
};

}  // namespace fringeslam
