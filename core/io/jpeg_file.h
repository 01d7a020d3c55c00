// SPDX-License-Identifier: Apache-2.0
// Encoding of JPEG files with libjpeg.
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace fringeslam {

// Encodes a gray image to memory; quality from 1 to 100. Throws Error if libjpeg refuses it: at most 65,500 pixels along a
// side.
std::string jpeg_bytes(const cv::Mat1b& image, int quality);

}  // namespace fringeslam
