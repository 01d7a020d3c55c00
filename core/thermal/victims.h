// SPDX-License-Identifier: Apache-2.0
// Victims of the map: warm regions of several views that lie in one place are one thing, and it is a victim when most
// of what the views saw of it was skin.
#pragma once

#include <string>
#include <vector>

#include "core/thermal/warm_regions.h"
#include "core/types/pose.h"

namespace fringeslam {

// What one view saw, and from where.
struct LocatedRegions {
  int view = 0;
  Pose world_from_camera;
  std::vector<WarmRegion> regions;
};

// A warm thing of the map.
struct WarmThing {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // world; of the largest region that says what it is
  double extent_m = 0;                                   // greatest distance of its points from there
  std::vector<Eigen::Vector3d> points_m;                 // world; some points of the regions that say so
  bool victim = false;
  std::string reason;
  double temperature_c = 0, area_m2 = 0;  // of the largest of those regions
  double skin_share = 0;                  // of what was seen, by area
  int views = 0, skin_views = 0;          // that saw it; that took it for skin
  int best_view = 0, best_region = 0;     // where the largest of those regions is
};

// In the order in which they came into view. Regions that are too small or too cold to be anything are left out.
std::vector<WarmThing> merge_regions(const std::vector<LocatedRegions>& views, const ThermalOptions& options);

}  // namespace fringeslam
