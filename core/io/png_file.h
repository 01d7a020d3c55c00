// SPDX-License-Identifier: Apache-2.0
// PNG files with libpng, which OpenImageIO would let print its own messages, and libdeflate.
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

// How the bytes of a row are predicted: by nothing, by the row above, or by what is best for the row.
enum class PngFilter { none, up, best_of_row };

struct PngEncoding {
  int level = 1;  // of compression: from 1 (fast) to 9 (small)
  // Rows with the same filter are compressed by libdeflate, which takes half of zlib's time.
  PngFilter filter = PngFilter::best_of_row;
};

// Encodes an image of unsigned 8 or 16 bits with one to four channels in the file's order (red, green, blue, alpha). Throws
// Error if libpng refuses it.
std::string encode_png(const cv::Mat& image, const PngEncoding& encoding);

}  // namespace fringeslam
