// SPDX-License-Identifier: Apache-2.0
// Line plots as images.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace fringeslam::tools {

struct PlotAxis {
  std::string label;
  double low = 0, high = 1;
};

struct PlotLine {
  std::vector<cv::Point2d> points;
  cv::Vec3b color{80, 220, 250};  // BGR
  int width = 2;
};

struct PlotMarks {
  std::vector<cv::Point2d> points;
  std::vector<double> sigma;  // half length of the error bars; empty: none
  cv::Vec3b color{80, 220, 250};
};

struct Plot {
  PlotAxis x, y;
  std::vector<PlotLine> lines;  // drawn first
  std::vector<PlotMarks> marks;
};

// Draws the plot at 740 x 740 px, with a grid and numbers at round values of both axes.
cv::Mat3b draw(const Plot& plot);

}  // namespace fringeslam::tools
