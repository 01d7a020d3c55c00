// SPDX-License-Identifier: Apache-2.0
#include "sim/light/texture_images.h"

#include <OpenImageIO/imagecache.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/texture.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <opencv2/core.hpp>

#include "core/io/files.h"
#include "core/types/error.h"

namespace fringeslam::sim {

namespace {

constexpr const char* kPixels = "fringeslam:pixels";

OIIO::TypeDesc format_of(const cv::Mat& pixels) {
  return pixels.depth() == CV_8U    ? OIIO::TypeDesc::UINT8
         : pixels.depth() == CV_16U ? OIIO::TypeDesc::UINT16
                                    : OIIO::TypeDesc::FLOAT;
}

// "Reads" an image in memory, whose address is an attribute of the configuration.
class PixelsInput final : public OIIO::ImageInput {
 public:
  static OIIO::ImageInput* create() { return new PixelsInput; }
  const char* format_name() const override { return "pixels"; }
  bool open(const std::string&, OIIO::ImageSpec&) override { return false; }
  bool open(const std::string&, OIIO::ImageSpec& spec, const OIIO::ImageSpec& config) override {
    void* address = nullptr;
    if (!config.getattribute(kPixels, OIIO::TypeDesc::PTR, &address) || address == nullptr) return false;
    pixels_ = static_cast<const cv::Mat*>(address);
    m_spec = OIIO::ImageSpec(pixels_->cols, pixels_->rows, pixels_->channels(), format_of(*pixels_));
    m_spec.alpha_channel = -1;
    spec = m_spec;
    return true;
  }
  bool close() override { return true; }
  bool read_native_scanline(int subimage, int miplevel, int y, int, void* data) override {
    if (subimage != 0 || miplevel != 0 || y < 0 || y >= pixels_->rows) return false;
    std::memcpy(data, pixels_->ptr(y), static_cast<size_t>(pixels_->cols) * pixels_->elemSize());
    return true;
  }

 private:
  const cv::Mat* pixels_ = nullptr;
};

float linear_from_srgb(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

// OpenImageIO's texture system and its cache, one for the program. Neither is ever destroyed: threads that outlive a cache
// keep their records of its tiles and take them for those of the next cache at the same address.
struct TextureCache {
  OIIO::ImageCache* images = OIIO::ImageCache::create(false);
  OIIO::TextureSystem* textures = OIIO::TextureSystem::create(false, images);
  std::atomic<uint64_t> names{0};

  TextureCache() {
    textures->attribute("automip", 1);
    textures->attribute("max_memory_MB", 512.0f);
  }
};

TextureCache& cache() {
  static TextureCache* const only = new TextureCache;
  return *only;
}

}  // namespace

struct TextureImages::Impl {
  struct Image {
    std::string file;
    cv::Mat pixels;
    OIIO::ustring name;
    OIIO::TextureSystem::TextureHandle* handle = nullptr;
  };
  std::deque<Image> images;  // OpenImageIO keeps their addresses

  ~Impl() {
    for (const Image& image : images) cache().images->invalidate(image.name, true);
  }
};

TextureImages::TextureImages() : impl_(std::make_unique<Impl>()) {}
TextureImages::~TextureImages() = default;

size_t TextureImages::add(const std::string& file) {
  const auto known =
      std::find_if(impl_->images.begin(), impl_->images.end(), [&](const auto& image) { return image.file == file; });
  if (known != impl_->images.end()) return static_cast<size_t>(known - impl_->images.begin());
  Impl::Image& image = impl_->images.emplace_back();
  image.file = file;
  image.pixels = read_pixels(file);
  image.name = OIIO::ustring("texture " + std::to_string(++cache().names));
  OIIO::ImageSpec config;
  const void* address = &image.pixels;
  config.attribute(kPixels, OIIO::TypeDesc::PTR, &address);
  OIIO::TextureSystem& textures = *cache().textures;
  cache().images->add_file(image.name, PixelsInput::create, &config);
  image.handle = textures.get_texture_handle(image.name);
  if (!image.handle || !textures.good(image.handle))
    throw Error(file + ": cannot be used as a texture: " + textures.geterror());
  return impl_->images.size() - 1;
}

float TextureImages::luminance(size_t texture, float s, float t, float width) const {
  const Impl::Image& image = impl_->images[texture];
  const bool grey = image.pixels.channels() < 3;
  OIIO::TextureOpt options;
  options.swrap = options.twrap = OIIO::TextureOpt::WrapPeriodic;
  options.fill = 0;
  float rgb[3] = {0, 0, 0};
  OIIO::TextureSystem& textures = *cache().textures;
  textures.texture(image.handle, textures.get_perthread_info(), options, s, t, width, 0, 0, width, grey ? 1 : 3, rgb);
  if (image.pixels.depth() != CV_32F) {
    for (float& channel : rgb) channel = linear_from_srgb(channel);
  }
  return grey ? rgb[0] : 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

}  // namespace fringeslam::sim
