// SPDX-License-Identifier: Apache-2.0
#include "core/io/files.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <memory>

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

namespace {

// OpenImageIO's messages may have several lines; Error messages have one.
std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

// Encodes to memory, because OpenImageIO's file writers do not detect a full disk.
std::string encoded(const char* name, OIIO::ImageSpec spec, const cv::Mat& pixels) {
  OIIO::Filesystem::IOVecOutput memory;
  void* proxy = &memory;
  spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  auto out = OIIO::ImageOutput::create(name);
  if (!out || !out->open(name, spec) ||
      !out->write_image(spec.format, pixels.data, OIIO::AutoStride, static_cast<OIIO::stride_t>(pixels.step)) ||
      !out->close())
    throw Error(std::string(name) + ": cannot be encoded: " + first_line(out ? out->geterror() : OIIO::geterror()));
  return {memory.buffer().begin(), memory.buffer().end()};
}

}  // namespace

// libpng's filters: none, and prediction by the row above.
constexpr int kNoFilter = 0x08, kUpFilter = 0x20;

std::string png_bytes(const cv::Mat& image, int compression) {
  cv::Mat pixels = image;
  if (image.type() == CV_8UC3) {  // OpenCV's BGR -> the file's RGB
    pixels = cv::Mat(image.size(), CV_8UC3);
    cv::mixChannels(image, pixels, {0, 2, 1, 1, 2, 0});
  }
  const OIIO::TypeDesc type = image.depth() == CV_16U ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8;
  OIIO::ImageSpec spec(image.cols, image.rows, image.channels(), type);
  spec.attribute("png:compressionLevel", compression);
  // Choosing the filter row by row, libpng's default, costs two thirds of the time of a fast level. False colours
  // are smallest without a filter, grey images with the row above as prediction.
  constexpr int kHighestFastLevel = 3;
  if (compression <= kHighestFastLevel) spec.attribute("png:filter", image.channels() == 1 ? kUpFilter : kNoFilter);
  return encoded("memory.png", spec, pixels);
}

std::string noisy_png_bytes(const cv::Mat& image) {
  const OIIO::TypeDesc type = image.depth() == CV_16U ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8;
  OIIO::ImageSpec spec(image.cols, image.rows, 1, type);
  spec.attribute("compression", "huffman");
  spec.attribute("png:filter", kUpFilter);
  return encoded("memory.png", spec, image);
}

std::string jpeg_bytes(const cv::Mat1b& image, int quality) {
  OIIO::ImageSpec spec(image.cols, image.rows, 1, OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", "jpeg:" + std::to_string(quality));
  return encoded("memory.jpg", spec, image);
}

void write_png(const fs::path& file, const cv::Mat& image) { write_text(file, png_bytes(image)); }

namespace {

// An EXR image as the writer takes it.
struct ExrImage {
  cv::Mat pixels;
  OIIO::ImageSpec spec;
};

ExrImage exr_image(const std::vector<ExrChannel>& channels, ExrCompression compression) {
  ExrImage exr;
  std::vector<cv::Mat> planes;
  for (const ExrChannel& channel : channels) planes.push_back(channel.image);
  cv::merge(planes, exr.pixels);
  exr.spec = OIIO::ImageSpec(exr.pixels.cols, exr.pixels.rows, exr.pixels.channels(), OIIO::TypeDesc::FLOAT);
  exr.spec.channelnames.clear();
  for (const ExrChannel& channel : channels) exr.spec.channelnames.push_back(channel.name);
  exr.spec.attribute("compression", compression == ExrCompression::zip           ? "zips"
                                    : compression == ExrCompression::run_lengths ? "rle"
                                                                                 : "none");
  // A fixed time stamp: OpenImageIO would write the current time and identical results would differ.
  exr.spec.attribute("DateTime", "1970:01:01 00:00:00");
  return exr;
}

}  // namespace

std::string exr_bytes(const std::vector<ExrChannel>& channels, ExrCompression compression) {
  const ExrImage exr = exr_image(channels, compression);
  return encoded("memory.exr", exr.spec, exr.pixels);
}

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

// Returns the usual extension of the format that the content has; images are often misnamed.
std::string image_format(const std::string& head, const fs::path& file) {
  const auto starts = [&](std::string_view magic) { return head.compare(0, magic.size(), magic) == 0; };
  using namespace std::string_view_literals;
  if (starts("\xff\xd8\xff"sv)) return "jpg";
  if (starts("\x76\x2f\x31\x01"sv)) return "exr";
  if (starts("II*\0"sv) || starts("MM\0*"sv)) return "tif";
  if (starts("RIFF"sv) && head.size() >= 12 && head.compare(8, 4, "WEBP") == 0) return "webp";
  const std::string extension = lower_extension(file);
  return extension.empty() ? "?" : extension.substr(1);
}

// An image file in memory, read with the reader of its format alone: OpenImageIO would otherwise try all of them.
// Formats that it cannot read from memory are opened by their descriptor, so that no other file can take their place.
class EncodedImage {
 public:
  explicit EncodedImage(const InputFile& input)
      : input_(input), in_(OIIO::ImageInput::create(image_format(input.head(12), input.path()))) {
    if (!in_) throw Error(name() + ": cannot be read as an image: its format is unknown");
    // Prevents OpenImageIO from premultiplying colours by alpha.
    OIIO::ImageSpec as_stored, ignored;
    as_stored.attribute("oiio:UnassociatedAlpha", 1);
    if (in_->supports("ioproxy")) {
      bytes_ = input.read();
      memory_.emplace(bytes_.data(), bytes_.size());
      void* proxy = &*memory_;
      as_stored.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    }
    if (!in_->open(memory_ ? input.path().filename().string() : descriptor(), ignored, as_stored))
      throw Error(name() + ": cannot be read as an image: " + message());
  }
  OIIO::ImageInput& input() { return *in_; }
  // Returns OpenImageIO's message without the name that it knows the file by.
  std::string message() {
    std::string text = first_line(in_->geterror());
    for (const std::string& known : {"\"" + descriptor() + "\"", descriptor()}) {
      for (size_t at; (at = text.find(known)) != std::string::npos;) text.replace(at, known.size(), "it");
    }
    return text;
  }

 private:
  std::string name() const { return input_.path().string(); }
  std::string descriptor() const { return "/proc/self/fd/" + std::to_string(input_.descriptor()); }

  const InputFile& input_;
  std::string bytes_;
  std::optional<OIIO::Filesystem::IOMemReader> memory_;
  std::unique_ptr<OIIO::ImageInput> in_;  // destroyed before what it reads from
};

// A deflated byte stands for at most 1032 bytes; run lengths and wavelets expand less. JPEG and WebP files may be smaller
// in relation, but have at most 16384 pixels along a side and 8 bits.
constexpr uint64_t kMostPerByte = 1100, kMostPerJpegByte = 1 << 20;

// Reads all channels as stored: unsigned 8 or 16 bits, or 32-bit float. If `names` is given, it receives the names of
// the channels, and pixels are converted to float.
cv::Mat read_image(const fs::path& file, const std::optional<ExpectedSize>& expected,
                   std::vector<std::string>* names = nullptr) {
  const InputFile input(file, kMostImageFileBytes);
  if (input.size() == 0) throw Error(file.string() + ": is empty; record or render it again");
  if (!names && is_png(input.head(8))) {
    return decode_png(input.read(), file.string(), [&](cv::Size size, uint64_t decoded) {
      check_declared(file, size, decoded, input.size(), kMostPerByte, expected);
    });
  }
  EncodedImage encoded_image(input);
  OIIO::ImageInput& in = encoded_image.input();
  const OIIO::ImageSpec& spec = in.spec();
  if (spec.nchannels < 1 || spec.nchannels > CV_CN_MAX)
    throw Error(file.string() + ": has " + std::to_string(spec.nchannels) + " channels; a camera image has one");
  const auto base = static_cast<OIIO::TypeDesc::BASETYPE>(spec.format.basetype);
  const int depth = names                            ? CV_32F
                    : base == OIIO::TypeDesc::UINT8  ? CV_8U
                    : base == OIIO::TypeDesc::UINT16 ? CV_16U
                                                     : CV_32F;
  const std::string extension = lower_extension(file);
  const bool lossy = extension == ".jpg" || extension == ".jpeg" || extension == ".webp";
  const cv::Size size(spec.width, spec.height);
  check_declared(file, size,
                 static_cast<uint64_t>(std::max(size.width, 0)) * static_cast<uint64_t>(std::max(size.height, 0)) *
                     CV_ELEM_SIZE(CV_MAKETYPE(depth, spec.nchannels)),
                 input.size(), lossy ? kMostPerJpegByte : kMostPerByte, expected);
  cv::Mat image(size, CV_MAKETYPE(depth, spec.nchannels));
  const OIIO::TypeDesc wanted = depth == CV_32F ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : OIIO::TypeDesc(base);
  // For truncated TIFF or JPEG files read_image() succeeds and only sets an error message.
  if (!in.read_image(0, 0, 0, spec.nchannels, wanted, image.data) || in.has_error())
    throw Error(file.string() + ": is truncated or damaged: " + encoded_image.message());
  if (names) *names = spec.channelnames;
  return image;
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
  if (is_png(bytes)) {
    const cv::Mat image = decode_png(bytes, name, [&](cv::Size size, uint64_t decoded) {
      check_declared(name, size, decoded, bytes.size(), kMostPerByte, {});
    });
    if (image.channels() == 1) return {image, {"Y"}};
    std::vector<std::string> channels = {"R", "G", "B", "A"};
    channels.resize(static_cast<size_t>(image.channels()));
    return {image, channels};
  }
  OIIO::Filesystem::IOMemReader memory(const_cast<char*>(bytes.data()), bytes.size());
  OIIO::ImageSpec config, spec;
  void* proxy = &memory;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  const auto in = OIIO::ImageInput::create("openexr");
  if (!in || !in->open("memory.exr", spec, config))
    throw Error(name + ": is not a PNG or EXR file, or damaged: " + first_line(in ? in->geterror() : OIIO::geterror()));
  if (spec.nchannels < 1 || spec.nchannels > CV_CN_MAX)
    throw Error(name + ": has " + std::to_string(spec.nchannels) + " channels; at most " + std::to_string(CV_CN_MAX) +
                " are read");
  const cv::Size size(spec.width, spec.height);
  check_declared(name, size,
                 static_cast<uint64_t>(std::max(size.width, 0)) * static_cast<uint64_t>(std::max(size.height, 0)) *
                     static_cast<uint64_t>(spec.nchannels) * sizeof(float),
                 bytes.size(), kMostPerByte, {});
  cv::Mat image(size, CV_MAKETYPE(CV_32F, spec.nchannels));
  if (!in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data) || in->has_error())
    throw Error(name + ": is truncated or damaged: " + first_line(in->geterror()));
  return {image, spec.channelnames};
}

cv::Mat read_grey(const fs::path& file, const std::optional<ExpectedSize>& expected) {
  cv::Mat image = read_image(file, expected);
  if (image.channels() != 1)
    throw Error(file.string() + ": has " + std::to_string(image.channels()) + " channels; a camera image has one");
  return image;
}

std::vector<ExrChannel> read_exr(const fs::path& file, const std::optional<ExpectedSize>& expected) {
  std::vector<std::string> names;
  std::vector<cv::Mat> planes;
  cv::split(read_image(file, expected, &names), planes);
  std::vector<ExrChannel> channels;
  for (size_t i = 0; i < planes.size(); ++i) channels.push_back({names[i], planes[i]});
  return channels;
}

void check_image(const fs::path& file) { (void)read_image(file, {}); }

cv::Mat read_as_grey(const fs::path& file, GreyFrom from) {
  const cv::Mat image = read_image(file, {});
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
  return luminance(red, green, blue);
}

}  // namespace fringeslam
