// SPDX-License-Identifier: Apache-2.0
// What decoding makes of a fringe stack: per camera pixel, where in the projector its light came from.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace fringeslam {

// A connected region of spatially unwrapped phase.
struct PhaseComponent {
  int pixels = 0;
  int votes = 0;         // of pixels that know their order by themselves
  double agreement = 0;  // share of the votes for the order taken
  bool absolute = false;
};

// All images H x W. NaN (fringe_order: -1) where invalid: wrapped_phase and sigma_px where there are no fringes,
// coordinate_px and confidence where their order is not known either.
struct DecodedStack {
  int index = 0;
  double timestamp_s = 0;
  std::string unwrapping;   // by which method
  cv::Mat1f mean;           // I', DN; valid everywhere
  cv::Mat1f modulation;     // I'' of the finest period, DN; valid everywhere
  cv::Mat1f wrapped_phase;  // finest period, rad, (-pi, pi]
  cv::Mat1i fringe_order;   // K of the finest period
  cv::Mat1f coordinate_px;  // projector column (or row), integer at pixel centres
  cv::Mat1f sigma_px;       // its standard deviation
  cv::Mat1f confidence;     // probability that the fringe order is right
  double full_scale_dn = 255;
  double finest_period_px = 0;  // 0: no fringes, the coordinate is that of a Gray code's cell

  // Of spatial unwrapping alone, else empty.
  cv::Mat1i component;       // index into components, -1 outside
  cv::Mat1f relative_phase;  // rad; of an unknown multiple of 2 pi in components that are not absolute
  std::vector<PhaseComponent> components;
};

}  // namespace fringeslam
