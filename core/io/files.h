// SPDX-License-Identifier: Apache-2.0
// Image files, and reading and writing of whole files.
#pragma once

#include <array>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/io/exr_encoder.h"
#include "core/io/staged.h"
#include "core/types/options.h"

namespace fringeslam {

// Returns the file name's extension in lower case, with the dot.
std::string lower_extension(const std::filesystem::path& file);

// Reads a whole regular file; empty if it does not exist. Throws Error if it cannot be read.
std::string read_bytes(const std::filesystem::path& file);

// PNG encoding to memory and to a file: CV_8UC1, CV_8UC3 (BGR, as in OpenCV) or CV_16UC1; compression level from 1
// (fast) to 9 (small).
std::string png_bytes(const cv::Mat& image, int compression = 1);
void write_png(const std::filesystem::path& file, const cv::Mat& image);

// EXR file, encoded as by exr_bytes().
void write_exr(const std::filesystem::path& file, const std::vector<ExrChannel>& channels,
               ExrCompression compression = ExrCompression::zip);

// Decodes a PNG or EXR file in memory, with channels in the order of the file: unsigned 8 or 16 bits, or 32-bit float.
// `name` is used in messages. Throws Error if the bytes are truncated or damaged.
struct DecodedImage {
  cv::Mat image;                      // H x W, with any number of channels
  std::vector<std::string> channels;  // their names
};
DecodedImage decode_image(const std::string& bytes, const std::string& name);

// The size that an image must have, and what determines it: "the camera of rig.yaml". It is compared with the size that
// the file declares before the image is allocated.
struct ExpectedSize {
  cv::Size size;
  std::string of;
};

// Limits of images without an expected size: pixels along a side, and bytes of the decoded image.
constexpr int kMostImageSide = 16384;
constexpr uint64_t kMostImageBytes = uint64_t{1} << 30;

// Reads a single-channel image: unsigned 8 or 16 bits (PNG, TIFF, BMP) or 32-bit float (EXR). Throws Error if the file
// is missing, truncated, no regular file, too large, or has more than one channel.
cv::Mat read_grey(const std::filesystem::path& file, const std::optional<ExpectedSize>& expected = {});

// Reads all channels of an EXR file as floats.
std::vector<ExrChannel> read_exr(const std::filesystem::path& file, const std::optional<ExpectedSize>& expected = {});

// Reads all channels of an image as stored: unsigned 8 or 16 bits or 32-bit float, RGB. Colors are not multiplied by alpha.
// Throws Error like read_grey(), but for the number of channels.
cv::Mat read_pixels(const std::filesystem::path& file);

// Reads an image completely and discards it. Throws Error like read_grey(), but for the number of channels.
void check_image(const std::filesystem::path& file);

enum class GreyFrom { luminance, red, green, blue };

constexpr auto choices(GreyFrom) {
  using enum GreyFrom;
  return std::to_array<Choice<GreyFrom>>({{luminance, "luminance"}, {red, "red"}, {green, "green"}, {blue, "blue"}});
}

// Share of full scale at which a channel may clip.
constexpr double kClipped = 0.98;

// Reads an image that may be in colour and converts it to grey. Alpha is ignored. If red, green and blue are equal,
// they are the grey value; otherwise it is the selected channel or the rounded luminance 0.299 R + 0.587 G + 0.114 B
// (Rec. 601). With `full_scale`, the luminance is at least that where a channel reaches kClipped times it: it may clip while the
// others are dark.
cv::Mat read_as_grey(const std::filesystem::path& file, GreyFrom from, std::optional<double> full_scale = {});

}  // namespace fringeslam
