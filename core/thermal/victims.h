// SPDX-License-Identifier: Apache-2.0
// Victims in the map (docs/method.md, section 10): warm regions of several views at one place are merged into one
// object, which is a victim if most of its observed area was classified as skin.
#pragma once

#include <string>
#include <vector>

#include "core/thermal/warm_regions.h"
#include "core/types/pose.h"

namespace fringeslam {

// The warm regions of one view, and its pose.
struct LocatedRegions {
  int view = 0;
  Pose world_from_camera;
  std::vector<WarmRegion> regions;
};

// A warm object in the map.
struct WarmObject {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // world; of the largest region with the object's class
  double extent_m = 0;                                   // greatest distance of its points from position_m
  std::vector<Eigen::Vector3d> points_m;                 // world; sampled points of the regions with that class
  bool victim = false;
  std::string reason;
  double temperature_c = 0, area_m2 = 0;  // of the largest of those regions
  double skin_share = 0;                  // of the observed area
  int views = 0, skin_views = 0;          // views that saw it; views that classified it as skin
  int best_view = 0, best_region = 0;     // view and index of the largest of those regions
};

// Merges the regions of all views, in the order of their first observation. Regions that are too small or too cold are
// ignored.
std::vector<WarmObject> merge_regions(const std::vector<LocatedRegions>& views, const ThermalOptions& options);

}  // namespace fringeslam
