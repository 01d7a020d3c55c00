// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>
#include <opencv2/core.hpp>

namespace fringeslam::test {

// True if two images of continuous rows have the same size, type and bits.
inline bool same_pixels(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

}  // namespace fringeslam::test
