// SPDX-License-Identifier: Apache-2.0
// Grey images as cameras send them (GenICam PFNC 2.1 and GigE Vision 2.0, section 27):
//
//   Mono8                      a byte a pixel
//   Mono10, 12, 14, 16         two bytes a pixel, the lower first
//   Mono10p, Mono12p           bits of one pixel after another, the lowest first
//   Mono10Packed, Mono12Packed two pixels in three bytes: the upper eight bits of each in the outer bytes, the lower
//                              ones in the middle byte, those of the first pixel in its lower half
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace fringeslam {

struct PixelFormat {
  std::string name;
  int bits = 8;
  uint32_t code = 0;  // in PFNC
};

// All that can be read; the first is the default.
const std::vector<PixelFormat>& pixel_formats();

// Throws Error when the name is none of them, naming the nearest.
const PixelFormat& pixel_format(const std::string& name);

// Bytes of an image without padding at the ends of lines.
size_t image_bytes(const PixelFormat& format, cv::Size size);

// CV_8UC1, or CV_16UC1 of more than eight bits. Throws Error when `bytes` is not image_bytes().
cv::Mat unpacked(const PixelFormat& format, cv::Size size, const void* data, size_t bytes);

}  // namespace fringeslam
