// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_decoder.h"

#include <array>
#include <optional>

#include "core/io/exr_file.h"
#include "core/io/image_library.h"
#include "core/io/png_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

using namespace std::string_view_literals;

// Readers that can read from memory, and their usual extensions. The others of OpenImageIO (video, raw, medical images
// …) would add the risks of their libraries.
struct ReaderName {
  const char* name;
  std::string_view extensions;  // each between spaces
};
constexpr std::array kReaders = {ReaderName{"png", " .png "},        ReaderName{"tiff", " .tif .tiff .tx "},
                                 ReaderName{"jpeg", " .jpg .jpeg "}, ReaderName{"webp", " .webp "},
                                 ReaderName{"bmp", " .bmp .dib "},   ReaderName{"pnm", " .pgm .ppm .pbm .pnm .pfm "},
                                 ReaderName{"targa", " .tga "},      ReaderName{"hdr", " .hdr .rgbe "},
                                 ReaderName{"gif", " .gif "},        ReaderName{"dds", " .dds "},
                                 ReaderName{"psd", " .psd "},        ReaderName{"jpeg2000", " .jp2 .j2k "},
                                 ReaderName{"dpx", " .dpx "}};

}  // namespace

std::string image_format(std::string_view head, const std::string& extension, const std::string& name) {
  if (is_png(head)) return "png";
  if (head.starts_with("\xff\xd8\xff"sv)) return "jpeg";
  if (head.starts_with("\x76\x2f\x31\x01"sv)) return "openexr";
  if (head.starts_with("II*\0"sv) || head.starts_with("MM\0*"sv)) return "tiff";
  if (head.starts_with("RIFF"sv) && head.size() >= 12 && head.substr(8, 4) == "WEBP"sv) return "webp";
  if (extension == ".exr")
    throw Error(name + ": cannot be read as an image: it does not begin like an EXR file; copy or export it again");
  for (const ReaderName& reader : kReaders) {
    if (!extension.empty() && reader.extensions.find(" " + extension + " ") != std::string_view::npos)
      return reader.name;
  }
  throw Error(name +
              ": cannot be read as an image: its format is unknown or not supported; convert it to PNG, TIFF or EXR");
}

std::optional<cv::Mat> decode_without_library(const std::string& bytes, const ImageRequest& request,
                                              const std::string& name, const AllocateImage& allocate) {
  if (!request.as_float && is_png(bytes)) return decode_png(bytes, name, allocate);
  // OpenImageIO sorts colors, which are stored alphabetically.
  if (request.format == "openexr") return decode_exr(bytes, name, allocate, request.as_float ? CV_CN_MAX : 1);
  return std::nullopt;
}

bool needs_library(const ImageRequest& request) {
  return request.format != "openexr" && (request.format != "png" || request.as_float);
}

cv::Mat decode_here(const std::string& bytes, const ImageRequest& request, const std::string& name,
                    const AllocateImage& allocate) {
  if (std::optional<cv::Mat> image = decode_without_library(bytes, request, name, allocate)) return *std::move(image);
  return image_library().decode(bytes, request, name, allocate);
}

}  // namespace fringeslam
