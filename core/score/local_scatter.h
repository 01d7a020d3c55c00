// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace fringeslam {

// Scatter of measurements around the smooth surface through them; medians over windows, NaN if there is none.
struct LocalScatter {
  double value = 0;       // standard deviation, in the measurement's unit
  double over_sigma = 0;  // divided by the predicted standard deviation
  int windows = 0;
};

// Fits a quadric to each 9 x 9 window that is at least 90 % valid, weighted by the predicted sigmas; `values` and
// `sigma` are H x W, NaN where invalid.
LocalScatter local_scatter(const cv::Mat1f& values, const cv::Mat1f& sigma);

// Replaces each valid value by that of the quadric fitted to the valid values within 4 px; NaN where fewer than 40 are
// valid.
cv::Mat1f locally_smoothed(const cv::Mat1f& values, const cv::Mat1f& sigma);

}  // namespace fringeslam
