// SPDX-License-Identifier: Apache-2.0
// Decoding of PNG files with libpng, which OpenImageIO would let print its own messages.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "core/io/image_decoder.h"

namespace fringeslam {

bool is_png(std::string_view bytes);

// Decodes a PNG: unsigned 8 or 16 bits, one to four channels (red, green, blue, alpha; not premultiplied). Palettes and
// fewer than 8 bits are expanded. `allocate` is called before memory of the image's size is allocated. Throws Error,
// naming the file `name`, if the data are damaged.
cv::Mat decode_png(const std::string& bytes, const std::string& name, const AllocateImage& allocate);

}  // namespace fringeslam
