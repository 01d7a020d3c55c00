// SPDX-License-Identifier: Apache-2.0
// Grey pixel formats of cameras (GenICam PFNC 2.1 and GigE Vision 2.0, section 27):
//
//   Mono8                      one byte per pixel
//   Mono10, 12, 14, 16         two bytes per pixel, little-endian
//   Mono10p, Mono12p           contiguous bit stream, least significant bit first
//   Mono10Packed, Mono12Packed two pixels in three bytes: the outer bytes hold the upper eight bits of each pixel, the
//                              middle byte the lower bits, those of the first pixel in its lower half
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
  uint32_t code = 0;  // PFNC code
};

// All supported formats; the first is the default.
const std::vector<PixelFormat>& pixel_formats();

// Finds a format by name. Throws Error naming the nearest format if there is none.
const PixelFormat& pixel_format(const std::string& name);

// Bytes of an image without line padding.
size_t image_bytes(const PixelFormat& format, cv::Size size);

// Checks the bytes that a camera announces for each image, before they are allocated: image_bytes(), and up to 1 MiB of padding
// and data about the image. Throws Error otherwise.
void check_payload(const PixelFormat& format, cv::Size size, uint64_t bytes);

// Unpacks to CV_8UC1, or CV_16UC1 for more than eight bits. Throws Error if `bytes` differs from image_bytes().
cv::Mat unpacked(const PixelFormat& format, cv::Size size, const void* data, size_t bytes);

}  // namespace fringeslam
