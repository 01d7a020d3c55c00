// SPDX-License-Identifier: Apache-2.0
// What decoding makes of a fringe stack: per camera pixel, where in the projector its light came from.
#pragma once

#include <opencv2/core.hpp>

namespace fringeslam {

// All images H x W; NaN (fringe_order: -1) where invalid.
struct DecodedStack {
  int index = 0;
  double timestamp_s = 0;
  cv::Mat1f mean;           // I', DN; valid everywhere
  cv::Mat1f modulation;     // I'' of the finest period, DN; valid everywhere
  cv::Mat1f wrapped_phase;  // finest period, rad, (-pi, pi]
  cv::Mat1i fringe_order;   // K of the finest period
  cv::Mat1f coordinate_px;  // projector column (or row), integer at pixel centres
  cv::Mat1f sigma_px;       // its standard deviation
  cv::Mat1f confidence;     // probability that all fringe orders are right
  double full_scale_dn = 255;
  double finest_period_px = 0;
};

}  // namespace fringeslam
