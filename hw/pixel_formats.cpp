// SPDX-License-Identifier: Apache-2.0
#include "hw/pixel_formats.h"

#include <cstdint>
#include <cstring>

#include "core/types/error.h"
#include "core/types/options.h"
#include "hw/words.h"

namespace fringeslam {

namespace {

enum class Packing { bytes, words, bit_stream, pairs };

Packing packing(const PixelFormat& format) {
  if (format.bits == 8) return Packing::bytes;
  if (format.name.ends_with("Packed")) return Packing::pairs;
  return format.name.ends_with("p") ? Packing::bit_stream : Packing::words;
}

void unpack_bit_stream(const uint8_t* data, int bits, cv::Mat1w& image) {
  uint32_t window = 0;
  int held = 0;
  for (ushort& value : image) {
    for (; held < bits; held += 8) window |= static_cast<uint32_t>(*data++) << held;
    value = static_cast<ushort>(window & ((1u << bits) - 1));
    window >>= bits;
    held -= bits;
  }
}

void unpack_pairs(const uint8_t* data, int bits, cv::Mat1w& image) {
  const int low_bits = bits - 8, mask = (1 << low_bits) - 1;
  size_t i = 0;
  for (ushort& value : image) {
    const uint8_t* pair = data + i / 2 * 3;
    const int outer = i % 2 == 0 ? pair[0] : pair[2], low = i % 2 == 0 ? pair[1] & mask : pair[1] >> 4 & mask;
    value = static_cast<ushort>(outer << low_bits | low);
    ++i;
  }
}

}  // namespace

const std::vector<PixelFormat>& pixel_formats() {
  static const std::vector<PixelFormat> all = {
      {"Mono8", 8, 0x01080001},         {"Mono10", 10, 0x01100003},  {"Mono12", 12, 0x01100005},
      {"Mono14", 14, 0x01100025},       {"Mono16", 16, 0x01100007},  {"Mono10Packed", 10, 0x010C0004},
      {"Mono12Packed", 12, 0x010C0006}, {"Mono10p", 10, 0x010A0046}, {"Mono12p", 12, 0x010C0047}};
  return all;
}

const PixelFormat& pixel_format(const std::string& name) {
  std::vector<std::string> names;
  for (const PixelFormat& format : pixel_formats()) {
    if (format.name == name) return format;
    names.push_back(format.name);
  }
  const std::string nearest = nearest_name(name, names);
  throw Error("pixel format '" + name + "' is not supported" +
              (nearest.empty() ? "; use Mono8 to Mono16 or a packed format" : "; did you mean '" + nearest + "'?"));
}

size_t image_bytes(const PixelFormat& format, cv::Size size) {
  const auto pixels = static_cast<size_t>(size.area()), bits = static_cast<size_t>(format.bits);
  switch (packing(format)) {
    case Packing::bytes:
      return pixels;
    case Packing::words:
      return 2 * pixels;
    case Packing::bit_stream:
      return (pixels * bits + 7) / 8;
    case Packing::pairs:
      return (pixels * 12 + 7) / 8;
  }
  return 0;
}

void check_payload(const PixelFormat& format, cv::Size size, uint64_t bytes) {
  constexpr uint64_t kMostMore = 1 << 20;
  const uint64_t image = image_bytes(format, size);
  if (bytes < image || bytes - image > kMostMore)
    throw Error("camera: announces " + std::to_string(bytes) + " bytes for each image, but one of " + to_words(size) +
                " in " + format.name + " has " + std::to_string(image) +
                "; restart the camera, and switch off what it adds to images (chunk data)");
}

cv::Mat unpacked(const PixelFormat& format, cv::Size size, const void* data, size_t bytes) {
  if (bytes != image_bytes(format, size))
    throw Error("camera: an image of " + to_words(size) + " in " + format.name + " has " +
                std::to_string(image_bytes(format, size)) + " bytes, not " + std::to_string(bytes));
  const auto* from = static_cast<const uint8_t*>(data);
  if (packing(format) == Packing::bytes) {
    cv::Mat1b image(size);
    std::memcpy(image.data, from, bytes);
    return image;
  }
  cv::Mat1w image(size);
  switch (packing(format)) {
    case Packing::bit_stream:
      unpack_bit_stream(from, format.bits, image);
      break;
    case Packing::pairs:
      unpack_pairs(from, format.bits, image);
      break;
    default:
      for (ushort& value : image) value = static_cast<ushort>(from[0] | from[1] << 8), from += 2;
  }
  return image;
}

}  // namespace fringeslam
