// SPDX-License-Identifier: Apache-2.0
// Decoding of this project's EXR files with OpenEXR's C library and libdeflate, which inflates twice as fast as zlib: reading
// ground truth is most of the time of scoring.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "core/io/image_decoder.h"

namespace fringeslam {

// Decodes an EXR file of one part with scan lines of 32-bit float channels, of `most_channels` at most, in alphabetical order
// but with those of layers ("normal.x") last; returns nothing for other files. `allocate` is called before memory of the image's size is allocated. Throws Error, naming the file `name`,
// if the data are damaged.
std::optional<cv::Mat> decode_exr(const std::string& bytes, const std::string& name, const AllocateImage& allocate,
                                  int most_channels = CV_CN_MAX);

}  // namespace fringeslam
