// SPDX-License-Identifier: Apache-2.0
// What a rig hands to the pipeline: the camera images of one whole pattern sequence, in the order of
// the sequence, and what a thermal camera sees meanwhile. It carries no truth.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct FringeStack {
  int index = 0;                   // position in the recording, from 0
  double timestamp_s = 0;          // of the middle of the sequence
  std::vector<cv::Mat> images;     // H x W each, CV_8UC1, CV_16UC1 or CV_32FC1 (unquantised), grey values in DN
  std::vector<double> exposure_s;  // one for each image
  cv::Mat1f thermal_c;             // apparent temperature in the thermal camera's pixels; empty: there is none
};

}  // namespace fringeslam
