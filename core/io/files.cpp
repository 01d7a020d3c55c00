// SPDX-License-Identifier: Apache-2.0
#include "core/io/files.h"

#include <algorithm>
#include <cctype>

#include "core/io/image_worker.h"
#include "core/io/input_file.h"
#include "core/io/png_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

std::string lower_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

std::string read_bytes(const fs::path& file) {
  std::error_code ignored;
  if (fs::status(file, ignored).type() == fs::file_type::not_found) return "";
  return read_input(file, kMostDataBytes);
}

std::string png_bytes(const cv::Mat& image, int compression) {
  cv::Mat pixels = image;
  if (image.type() == CV_8UC3) {  // OpenCV's BGR -> the file's RGB
    pixels = cv::Mat(image.size(), CV_8UC3);
    cv::mixChannels(image, pixels, {0, 2, 1, 1, 2, 0});
  }
  PngEncoding encoding;
  encoding.level = compression;
  // Choosing the filter row by row takes longer than all else at a fast level. False colours are smallest without a
  // filter, grey images with the row above as prediction.
  constexpr int kHighestFastLevel = 3;
  if (compression <= kHighestFastLevel) encoding.filter = image.channels() == 1 ? PngFilter::up : PngFilter::none;
  return encode_png(pixels, encoding);
}

void write_png(const fs::path& file, const cv::Mat& image) { write_text(file, png_bytes(image)); }

void write_exr(const fs::path& file, const std::vector<ExrChannel>& channels, ExrCompression compression) {
  write_text(file, exr_bytes(channels, compression));
}

namespace {

// Refuses a declared size before anything of that size is allocated. `most_per_byte` limits the decoded bytes by those of
// the file: a small file that declares a huge image is damaged or hostile.
void check_declared(const fs::path& file, cv::Size size, uint64_t decoded, uint64_t file_bytes, uint64_t most_per_byte,
                    const std::optional<ExpectedSize>& expected) {
  const std::string declared = std::to_string(size.width) + "x" + std::to_string(size.height);
  if (expected && size != expected->size)
    throw Error(file.string() + ": is " + declared + " but " + expected->of + " has " +
                std::to_string(expected->size.width) + "x" + std::to_string(expected->size.height));
  if (size.width < 1 || size.height < 1) throw Error(file.string() + ": invalid image size");
  if (size.width > kMostImageSide || size.height > kMostImageSide)
    throw Error(file.string() + ": is " + declared + "; at most " + std::to_string(kMostImageSide) +
                " pixels along a side are read");
  if (!expected && decoded > kMostImageBytes)
    throw Error(file.string() + ": has " + std::to_string(decoded >> 20) + " MiB of pixels; at most " +
                std::to_string(kMostImageBytes >> 20) + " MiB are read from an image");
  constexpr uint64_t kSmall = 1 << 20;
  if (decoded > kSmall && (decoded - kSmall) / most_per_byte > file_bytes)
    throw Error(file.string() + ": is truncated or damaged: it declares " + declared + " pixels but has only " +
                std::to_string(file_bytes) + " bytes");
}

// A deflated byte stands for at most 1032 bytes; run lengths and wavelets expand less. JPEG and WebP files may be smaller
// in relation, but have at most 16384 pixels along a side and 8 bits.
constexpr uint64_t kMostPerByte = 1100, kMostPerJpegByte = 1 << 20;

DecodedImage decoded(const ImageSource& source, const ImageRequest& request,
                     const std::optional<ExpectedSize>& expected) {
  DecodedImage result;
  const bool lossy = request.format == "jpeg" || request.format == "webp";
  result.image = decode_image_file(source, request, [&](const ImageHeader& header) {
    const auto side = [](int pixels) { return static_cast<uint64_t>(std::max(pixels, 0)); };
    check_declared(source.name, header.size,
                   side(header.size.width) * side(header.size.height) * CV_ELEM_SIZE(header.type), source.size,
                   lossy ? kMostPerJpegByte : kMostPerByte, expected);
    result.channels = header.channels;
    return cv::Mat(header.size, header.type);
  });
  return result;
}

DecodedImage read_image(const fs::path& file, const std::optional<ExpectedSize>& expected, bool as_float = false) {
  const InputFile input(file, kMostImageFileBytes);
  const std::string name = file.string();
  if (input.size() == 0) throw Error(name + ": is empty; record or render it again");
  return decoded({input.descriptor(), nullptr, input.size(), name},
                 {image_format(input.head(12), lower_extension(file), name), as_float}, expected);
}

bool same_values(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF) == 0; }

cv::Mat luminance(const cv::Mat& red, const cv::Mat& green, const cv::Mat& blue) {
  cv::Mat sum = cv::Mat::zeros(red.size(), CV_32F);
  cv::scaleAdd(cv::Mat1f(red), 0.299, sum, sum);
  cv::scaleAdd(cv::Mat1f(green), 0.587, sum, sum);
  cv::scaleAdd(cv::Mat1f(blue), 0.114, sum, sum);
  sum.convertTo(sum, red.type());  // rounds
  return sum;
}

}  // namespace

DecodedImage decode_image(const std::string& bytes, const std::string& name) {
  const std::string format = is_png(bytes) ? "png" : "openexr";
  return decoded({-1, &bytes, bytes.size(), name}, {format}, {});
}

cv::Mat read_grey(const fs::path& file, const std::optional<ExpectedSize>& expected) {
  cv::Mat image = read_image(file, expected).image;
  if (image.channels() != 1)
    throw Error(file.string() + ": has " + std::to_string(image.channels()) + " channels; a camera image has one");
  return image;
}

std::vector<ExrChannel> read_exr(const fs::path& file, const std::optional<ExpectedSize>& expected) {
  const auto [image, names] = read_image(file, expected, true);
  std::vector<cv::Mat> planes;
  cv::split(image, planes);
  std::vector<ExrChannel> channels;
  for (size_t i = 0; i < planes.size(); ++i) channels.push_back({names[i], planes[i]});
  return channels;
}

cv::Mat read_pixels(const fs::path& file) { return read_image(file, {}).image; }

void check_image(const fs::path& file) { (void)read_pixels(file); }

cv::Mat read_as_grey(const fs::path& file, GreyFrom from, std::optional<double> full_scale) {
  const cv::Mat image = read_image(file, {}).image;
  std::vector<cv::Mat> channels;
  cv::split(image, channels);
  if (channels.size() < 3) return channels[0];  // grey, or grey and alpha
  const cv::Mat &red = channels[0], &green = channels[1], &blue = channels[2];
  if (same_values(red, green) && same_values(red, blue)) return red;
  switch (from) {
    case GreyFrom::red:
      return red;
    case GreyFrom::green:
      return green;
    case GreyFrom::blue:
      return blue;
    case GreyFrom::luminance:
      break;
  }
  cv::Mat grey = luminance(red, green, blue);
  if (full_scale) {
    const cv::Mat brightest = cv::max(cv::max(red, green), blue);
    cv::Mat(cv::max(brightest, *full_scale)).copyTo(grey, brightest >= kClipped * *full_scale);
  }
  return grey;
}

}  // namespace fringeslam
