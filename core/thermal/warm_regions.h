// SPDX-License-Identifier: Apache-2.0
// Warm regions of a view and their classification as possible skin of a victim (docs/method.md, section 10). A region
// is connected in the image and in depth; its rim, caused by the thermal camera's blur, is excluded. Regions are
// tested for temperature, area and shape; each carries the reason for its classification.
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
  WarmKind kind = WarmKind::skin;  // skin marks a candidate
  std::string reason;
  int pixels = 0;
  double area_m2 = 0;
  double mean_c = 0, warmest_c = 0, max_c = 0,
         spread_c = 0;  // warmest: the 80th percentile; spread: standard deviation
  double planar_share = 0;
  PipeFit pipe;
  Eigen::Vector3d centre_m = Eigen::Vector3d::Zero();  // camera frame
  std::vector<Eigen::Vector3d> points_m;               // some of its points, evenly sampled
  cv::Rect box;                                        // in the image
  bool candidate() const { return kind == WarmKind::skin; }
};

struct WarmView {
  double surroundings_c = 0;  // NaN if no temperature is known
  cv::Mat1i regions;          // H x W: index of the pixel's region, -1: none
  std::vector<WarmRegion> list;
};

// Finds and classifies the warm regions of a frame; regions of fewer than 12 pixels are dropped.
WarmView find_warm_regions(const Frame& frame, const RegisteredThermal& thermal, const RigModel& rig,
                           const ThermalOptions& options);

// Returns the temperature statistics of each landmark's pixels within its outline. `temperature_c` is H x W of the frame,
// NaN where unknown.
std::vector<LandmarkTemperature> landmark_temperatures(const cv::Mat1f& temperature_c, const WarmView& warm,
                                                       const Landmarks& landmarks, const ThermalOptions& options);

}  // namespace fringeslam
