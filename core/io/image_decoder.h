// SPDX-License-Identifier: Apache-2.0
// Decoding of image files by libpng, OpenEXR's C library and OpenImageIO in the calling process.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fringeslam {

// How an image file is decoded.
struct ImageRequest {
  std::string format;     // name of OpenImageIO's reader, for content that is no PNG: "openexr", "tiff"
  bool as_float = false;  // converts integers to 0..1, and takes all formats, PNG too, from OpenImageIO
};

// The header of an image file, read before its pixels are decoded.
struct ImageHeader {
  cv::Size size;
  int type = 0;                       // of OpenCV: CV_8UC1, CV_16UC3, CV_32FC2
  std::vector<std::string> channels;  // their names: "Y", "R"
};

// Returns the image that pixels are decoded into, or throws Error if the header is not acceptable.
using AllocateImage = std::function<cv::Mat(const ImageHeader&)>;

// Returns the name of the reader for a file that starts with `head`, or else has this extension in lower case (".tif");
// images are often misnamed. Throws Error, naming the file `name`, if it is none that is read.
std::string image_format(std::string_view head, const std::string& extension, const std::string& name);

// Like decode_here(), for PNG files and most EXR files; returns nothing for files that need OpenImageIO.
std::optional<cv::Mat> decode_without_library(const std::string& bytes, const ImageRequest& request,
                                              const std::string& name, const AllocateImage& allocate);

// True if decode_without_library() returns nothing for all files of the request's format.
bool needs_library(const ImageRequest& request);

// Decodes the first image of a file with all channels as stored: unsigned 8 or 16 bits, or 32-bit float. Colours are not
// multiplied by alpha. `allocate` is called before anything of the
// declared size is allocated. Throws Error,
// naming the file `name`, if the file is damaged.
cv::Mat decode_here(const std::string& bytes, const ImageRequest& request, const std::string& name,
                    const AllocateImage& allocate);

}  // namespace fringeslam
