// SPDX-License-Identifier: Apache-2.0
// Regions of a view that are warmer than what surrounds them, and which of them may be a victim's skin. A region is
// connected in the image and in depth; its rim, which the thermal camera's blur brings, is left out. Gates judge its
// temperature, its area and its shape; each region says in words why it is a candidate or is not.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/thermal/options.h"
#include "core/thermal/registration.h"
#include "core/thermal/shape.h"
#include "core/types/landmark.h"

namespace fringeslam {

enum class WarmKind { skin, too_cold, too_hot, too_small, too_large, flat, pipe };
std::string to_string(WarmKind kind);

struct WarmRegion {
  WarmKind kind = WarmKind::skin;  // a candidate where it is skin
  std::string reason;
  int pixels = 0;
  double area_m2 = 0;
  double mean_c = 0, warmest_c = 0, max_c = 0,
         spread_c = 0;  // warmest: the 80th percentile; spread: standard deviation
  double planar_share = 0;
  PipeFit pipe;
  Eigen::Vector3d centre_m = Eigen::Vector3d::Zero();  // camera frame
  std::vector<Eigen::Vector3d> points_m;               // some of its points, evenly over it
  cv::Rect box;                                        // in the image
  bool candidate() const { return kind == WarmKind::skin; }
};

struct WarmView {
  double surroundings_c = 0;  // NaN when no temperature is known
  cv::Mat1i regions;          // H x W: number of the pixel's region, -1: none
  std::vector<WarmRegion> list;
};

// Of regions of fewer than a dozen pixels nothing is said.
WarmView find_warm_regions(const Frame& frame, const RegisteredThermal& thermal, const RigModel& rig,
                           const ThermalOptions& options);

// What each landmark's temperature is, and the warm regions on it.
void note_temperatures(const Frame& frame, const WarmView& warm, Landmarks& landmarks, const ThermalOptions& options);

}  // namespace fringeslam
