// SPDX-License-Identifier: Apache-2.0
// OpenImageIO, loaded when it is first used: it and the 260 libraries that it depends on take 0.3 s of processor time, which
// is more than everything else that the program does before its work. PNG, JPEG and the EXR files of this project do not
// need it.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/io/image_decoder.h"

namespace fringeslam {

// An image for filtered lookups. Any number of threads may use it.
class FilteredImage {
 public:
  virtual ~FilteredImage() = default;
  // Returns the first channels, three at most, at coordinates of which the image covers 0..1 and is repeated beyond,
  // averaged over a square of this width. Integers become 0..1.
  virtual void look_up(float s, float t, float width, int channels, float* values) const = 0;
};

class ImageLibrary {
 public:
  // Like decode_here(), for all formats.
  virtual cv::Mat decode(const std::string& bytes, const ImageRequest& request, const std::string& name,
                         const AllocateImage& allocate) const = 0;
  // Throws Error, naming the image `name`.
  virtual std::unique_ptr<FilteredImage> filtered(const cv::Mat& pixels, const std::string& name) const = 0;
  // Returns frames (BGR, of equal size) as a GIF file of an animation that repeats. Throws Error, naming the image `name`.
  virtual std::string gif_bytes(const std::vector<cv::Mat3b>& frames, int frames_per_second,
                                const std::string& name) const = 0;
  virtual void use_no_threads() const = 0;

 protected:
  ~ImageLibrary() = default;
};

// Loads the library unless it is loaded. Throws Error if it cannot be loaded. Any number of threads may call it.
const ImageLibrary& image_library();

// From now on, the library decodes in the calling thread alone. For processes that fork after reading images, because their
// children lack the threads of the library and would wait for them, and for processes of which one runs per processor. Call
// it before the first image is read. It does not load the library.
void use_no_image_threads();

}  // namespace fringeslam
