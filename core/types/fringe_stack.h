// SPDX-License-Identifier: Apache-2.0
// Input of the pipeline: the camera images of one pattern sequence, in sequence order, and the thermal image taken with
// it. Contains no ground truth.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct FringeStack {
  int index = 0;                   // position in the recording, from 0
  double timestamp_s = 0;          // middle of the sequence
  std::vector<cv::Mat> images;     // each H x W, CV_8UC1, CV_16UC1 or CV_32FC1 (unquantised), grey values in DN
  std::vector<double> exposure_s;  // one per image
  cv::Mat1f thermal_c;             // apparent temperature in the thermal camera's pixel grid; empty: no thermal camera
};

}  // namespace fringeslam
