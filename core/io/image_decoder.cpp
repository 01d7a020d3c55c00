// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_decoder.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <array>
#include <memory>
#include <optional>
#include <utility>

#include "core/io/exr_file.h"
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
constexpr std::array kReaders = {ReaderName{"png", " .png "},
                                 ReaderName{"tiff", " .tif .tiff .tx "},
                                 ReaderName{"openexr", " .exr "},
                                 ReaderName{"jpeg", " .jpg .jpeg "},
                                 ReaderName{"webp", " .webp "},
                                 ReaderName{"bmp", " .bmp .dib "},
                                 ReaderName{"pnm", " .pgm .ppm .pbm .pnm .pfm "},
                                 ReaderName{"targa", " .tga "},
                                 ReaderName{"hdr", " .hdr .rgbe "},
                                 ReaderName{"gif", " .gif "},
                                 ReaderName{"dds", " .dds "},
                                 ReaderName{"psd", " .psd "},
                                 ReaderName{"jpeg2000", " .jp2 .j2k "},
                                 ReaderName{"dpx", " .dpx "}};

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

}  // namespace

std::string image_format(std::string_view head, const std::string& extension, const std::string& name) {
  if (is_png(head)) return "png";
  if (head.starts_with("\xff\xd8\xff"sv)) return "jpeg";
  if (head.starts_with("\x76\x2f\x31\x01"sv)) return "openexr";
  if (head.starts_with("II*\0"sv) || head.starts_with("MM\0*"sv)) return "tiff";
  if (head.starts_with("RIFF"sv) && head.size() >= 12 && head.substr(8, 4) == "WEBP"sv) return "webp";
  for (const ReaderName& reader : kReaders) {
    if (!extension.empty() && reader.extensions.find(" " + extension + " ") != std::string_view::npos)
      return reader.name;
  }
  throw Error(name +
              ": cannot be read as an image: its format is unknown or not supported; convert it to PNG, TIFF or EXR");
}

cv::Mat decode_here(const std::string& bytes, const ImageRequest& request, const std::string& name,
                    const AllocateImage& allocate) {
  if (!request.as_float && is_png(bytes)) return decode_png(bytes, name, allocate);
  if (request.as_float && request.format == "openexr") {
    if (std::optional<cv::Mat> image = decode_exr(bytes, name, allocate)) return *std::move(image);
  }
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

}  // namespace fringeslam
