// SPDX-License-Identifier: Apache-2.0
// Formats sizes for the messages of this folder.
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace fringeslam {

inline std::string to_words(cv::Size size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + " px";
}

}  // namespace fringeslam
