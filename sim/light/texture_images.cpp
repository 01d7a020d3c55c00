// SPDX-License-Identifier: Apache-2.0
#include "sim/light/texture_images.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

#include "core/io/files.h"
#include "core/io/image_library.h"

namespace fringeslam::sim {

namespace {

float linear_from_srgb(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

}  // namespace

struct TextureImages::Impl {
  struct Image {
    std::string file;
    bool grey = false, linear = false;
    std::unique_ptr<FilteredImage> pixels;
  };
  std::vector<Image> images;
};

TextureImages::TextureImages() : impl_(std::make_unique<Impl>()) {}
TextureImages::~TextureImages() = default;

size_t TextureImages::add(const std::string& file) {
  const auto known =
      std::find_if(impl_->images.begin(), impl_->images.end(), [&](const auto& image) { return image.file == file; });
  if (known != impl_->images.end()) return static_cast<size_t>(known - impl_->images.begin());
  const cv::Mat pixels = read_pixels(file);
  impl_->images.push_back(
      {file, pixels.channels() < 3, pixels.depth() == CV_32F, image_library().filtered(pixels, file)});
  return impl_->images.size() - 1;
}

float TextureImages::luminance(size_t texture, float s, float t, float width) const {
  const Impl::Image& image = impl_->images[texture];
  float rgb[3] = {0, 0, 0};
  image.pixels->look_up(s, t, width, image.grey ? 1 : 3, rgb);
  if (!image.linear) {
    for (float& channel : rgb) channel = linear_from_srgb(channel);
  }
  return image.grey ? rgb[0] : 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

}  // namespace fringeslam::sim
