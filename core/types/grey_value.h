// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace fringeslam {

// Returns the grey value, DN, of a pixel of an image of type CV_8UC1, CV_16UC1 or CV_32FC1.
inline float grey_value(const cv::Mat& image, int row, int col) {
  switch (image.depth()) {
    case CV_8U: return image.at<uint8_t>(row, col);
    case CV_16U: return image.at<uint16_t>(row, col);
    default: return image.at<float>(row, col);
  }
}

}  // namespace fringeslam
