// SPDX-License-Identifier: Apache-2.0
#include "core/io/oiio_library.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imagecache.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/texture.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <utility>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// --- decoding ---

// OpenImageIO's messages may have several lines; Error messages have one.
std::string one_line(const std::string& text) { return text.substr(0, text.find('\n')); }

// An image in memory, read with the reader of its format alone: OpenImageIO would otherwise try all of them.
class EncodedImage {
 public:
  EncodedImage(const std::string& bytes, const std::string& format, const std::string& name)
      : memory_(const_cast<char*>(bytes.data()), bytes.size()), in_(OIIO::ImageInput::create(format)) {
    if (!in_) throw Error(name + ": cannot be read as an image: " + one_line(OIIO::geterror()));
    // Prevents OpenImageIO from premultiplying colours by alpha.
    OIIO::ImageSpec as_stored, ignored;
    as_stored.attribute("oiio:UnassociatedAlpha", 1);
    void* proxy = &memory_;
    as_stored.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    if (!in_->open("it", ignored, as_stored)) throw Error(name + ": cannot be read as an image: " + message());
  }
  OIIO::ImageInput& input() { return *in_; }
  // Returns OpenImageIO's message, in which the file is called "it".
  std::string message() {
    std::string text = one_line(in_->geterror());
    for (size_t at; (at = text.find("\"it\"")) != std::string::npos;) text.replace(at, 4, "it");
    return text;
  }

 private:
  OIIO::Filesystem::IOMemReader memory_;
  std::unique_ptr<OIIO::ImageInput> in_;  // destroyed before what it reads from
};

int stored_depth(const OIIO::ImageSpec& spec, bool as_float) {
  if (!as_float && spec.format.basetype == OIIO::TypeDesc::UINT8) return CV_8U;
  if (!as_float && spec.format.basetype == OIIO::TypeDesc::UINT16) return CV_16U;
  return CV_32F;
}

cv::Mat decode_with_oiio(const std::string& bytes, const ImageRequest& request, const std::string& name,
                         const AllocateImage& allocate) {
  // OpenEXR's C library reads channels of 32 bits two to three times as fast as its C++ library, the default.
  [[maybe_unused]] static const bool fast_exr = OIIO::attribute("openexr:core", 1);
  EncodedImage image(bytes, request.format, name);
  OIIO::ImageInput& in = image.input();
  const OIIO::ImageSpec& spec = in.spec();
  if (spec.nchannels < 1 || spec.nchannels > CV_CN_MAX)
    throw Error(name + ": has " + std::to_string(spec.nchannels) + " channels; a camera image has one");
  if (spec.depth > 1 || spec.deep)  // whose pixels would exceed width times height
    throw Error(name + ": has layers of depth; export it as a plain image");
  ImageHeader header{{spec.width, spec.height}, CV_MAKETYPE(stored_depth(spec, request.as_float), spec.nchannels), {}};
  header.channels = spec.channelnames;
  header.channels.resize(static_cast<size_t>(spec.nchannels));
  cv::Mat pixels = allocate(header);
  const OIIO::TypeDesc wanted = pixels.depth() == CV_32F
                                    ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT)
                                    : OIIO::TypeDesc(static_cast<OIIO::TypeDesc::BASETYPE>(spec.format.basetype));
  // For truncated TIFF or JPEG files read_image() succeeds and only sets an error message.
  if (!in.read_image(0, 0, 0, spec.nchannels, wanted, pixels.data) || in.has_error())
    throw Error(name + ": is truncated or damaged: " + image.message());
  return pixels;
}

// --- filtered lookup ---

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

class OiioFilteredImage final : public FilteredImage {
 public:
  OiioFilteredImage(cv::Mat pixels, const std::string& name)
      : pixels_(std::move(pixels)), name_("texture " + std::to_string(++cache().names)) {
    OIIO::ImageSpec config;
    const void* address = &pixels_;
    config.attribute(kPixels, OIIO::TypeDesc::PTR, &address);
    OIIO::TextureSystem& textures = *cache().textures;
    cache().images->add_file(name_, PixelsInput::create, &config);
    handle_ = textures.get_texture_handle(name_);
    if (!handle_ || !textures.good(handle_))
      throw Error(name + ": cannot be used as a texture: " + one_line(textures.geterror()));
  }
  ~OiioFilteredImage() override { cache().images->invalidate(name_, true); }
  OiioFilteredImage(const OiioFilteredImage&) = delete;
  OiioFilteredImage& operator=(const OiioFilteredImage&) = delete;

  void look_up(float s, float t, float width, int channels, float* values) const override {
    OIIO::TextureOpt options;
    options.swrap = options.twrap = OIIO::TextureOpt::WrapPeriodic;
    options.fill = 0;
    OIIO::TextureSystem& textures = *cache().textures;
    textures.texture(handle_, textures.get_perthread_info(), options, s, t, width, 0, 0, width, channels, values);
  }

 private:
  const cv::Mat pixels_;  // OpenImageIO keeps its address
  OIIO::ustring name_;
  OIIO::TextureSystem::TextureHandle* handle_ = nullptr;
};

class OiioLibrary final : public ImageLibrary {
 public:
  cv::Mat decode(const std::string& bytes, const ImageRequest& request, const std::string& name,
                 const AllocateImage& allocate) const override {
    return decode_with_oiio(bytes, request, name, allocate);
  }

  std::unique_ptr<FilteredImage> filtered(const cv::Mat& pixels, const std::string& name) const override {
    return std::make_unique<OiioFilteredImage>(pixels, name);
  }

  std::string gif_bytes(const std::vector<cv::Mat3b>& frames, int frames_per_second,
                        const std::string& name) const override {
    const auto fail = [&](const std::string& why) { throw Error(name + ": cannot be encoded: " + one_line(why)); };
    // OpenImageIO ignores failures to write a GIF file.
    OIIO::Filesystem::IOVecOutput memory;
    const auto output = OIIO::ImageOutput::create("gif");
    if (!output) fail(OIIO::geterror());
    if (!output->supports("ioproxy")) fail("this OpenImageIO writes GIF to files only; version 2.4 is needed");
    OIIO::ImageSpec spec(frames.at(0).cols, frames.at(0).rows, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("FramesPerSecond", OIIO::TypeDesc::TypeRational, std::array<int, 2>{frames_per_second, 1}.data());
    void* proxy = &memory;
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    auto mode = OIIO::ImageOutput::Create;
    for (const cv::Mat3b& frame : frames) {
      cv::Mat rgb(frame.size(), CV_8UC3);
      cv::mixChannels(cv::Mat(frame), rgb, {0, 2, 1, 1, 2, 0});
      if (!output->open("it", spec, mode) || !output->write_image(OIIO::TypeDesc::UINT8, rgb.data))
        fail(output->geterror());
      mode = OIIO::ImageOutput::AppendSubimage;
    }
    if (!output->close()) fail(output->geterror());
    return {memory.buffer().begin(), memory.buffer().end()};
  }

  void use_no_threads() const override {
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", -1);  // no pool of OpenEXR's own
  }
};

}  // namespace

}  // namespace fringeslam

const fringeslam::ImageLibrary* fringeslam_oiio_library() {
  static const fringeslam::OiioLibrary library;
  return &library;
}
