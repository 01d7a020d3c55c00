// SPDX-License-Identifier: Apache-2.0
#include "core/io/files.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <stdlib.h>
#include <zlib.h>

#include <cstring>
#include <fstream>
#include <sstream>

#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

// Marker file in folders written by StagedFolder; contains the kind.
constexpr const char* kMarkerFile = ".fringeslam";

// Creates a temporary folder next to `target`, on the same file system.
fs::path sibling_folder(const fs::path& target) {
  std::string name = target.string() + ".partial-XXXXXX";
  if (!mkdtemp(name.data()))
    throw Error(target.string() + ": cannot create a temporary folder next to it: " + std::strerror(errno));
  return name;
}

}  // namespace

std::string lower_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

std::string read_bytes(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

StagedFolder::StagedFolder(fs::path target, std::string kind) : target_(std::move(target)), kind_(std::move(kind)) {
  if (target_.filename().empty()) target_ = target_.parent_path();
  std::error_code failed;
  const bool ours = !kind_.empty() && read_bytes(target_ / kMarkerFile) == kind_ + "\n";
  const bool empty = fs::is_directory(target_, failed) && fs::is_empty(target_, failed);
  if (fs::exists(target_, failed) && !ours && !empty)
    throw Error(target_.string() + ": exists" +
                (kind_.empty() ? "" : " and was not written by fringeslam as a " + kind_) +
                "; choose another --out or remove it");
  if (target_.has_parent_path()) {
    failed.clear();
    fs::create_directories(target_.parent_path(), failed);
    if (failed) throw Error(target_.string() + ": cannot create its parent folder: " + failed.message());
  }
  staging_ = sibling_folder(target_);
  fs::permissions(staging_, fs::perms(0755), failed);
}

StagedFolder::~StagedFolder() {
  std::error_code ignored;
  if (!committed_) fs::remove_all(staging_, ignored);
}

void StagedFolder::commit() {
  if (!kind_.empty()) write_text(staging_ / kMarkerFile, kind_ + "\n");
  std::error_code failed;
  // The old folder is moved aside first, so that a failed rename does not lose both.
  fs::path aside;
  if (fs::exists(target_, failed)) {
    aside = sibling_folder(target_);
    fs::rename(target_, aside / "old", failed);
  }
  if (!failed) fs::rename(staging_, target_, failed);
  if (failed) {
    std::error_code ignored;
    if (!aside.empty()) fs::rename(aside / "old", target_, ignored);
    if (!aside.empty()) fs::remove(aside, ignored);
    throw Error(target_.string() + ": cannot be moved into place: " + failed.message());
  }
  committed_ = true;
  if (!aside.empty()) fs::remove_all(aside, failed);
}

StagedFile::StagedFile(fs::path target) : target_(std::move(target)) {
  std::string name = target_.string() + ".partial-XXXXXX";
  if (target_.filename().empty() || fs::is_directory(target_))
    throw Error(target_.string() + ": cannot be written: it is a folder");
  if (!mkdtemp(name.data())) throw Error(target_.string() + ": cannot be written: " + std::strerror(errno));
  staging_ = name;
}

StagedFile::~StagedFile() {
  std::error_code ignored;
  fs::remove_all(staging_, ignored);
}

void StagedFile::commit() {
  const auto put_in_place = [&](const fs::path& file) {
    std::error_code failed;
    fs::rename(file, target_.parent_path() / file.filename(), failed);
    if (failed)
      throw Error((target_.parent_path() / file.filename()).string() + ": cannot be written: " + failed.message());
  };
  std::vector<fs::path> others;
  for (const auto& entry : fs::directory_iterator(staging_)) {
    if (entry.path() != path()) others.push_back(entry.path());
  }
  for (const fs::path& file : others) put_in_place(file);
  put_in_place(path());
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(file.string() + ": cannot be written; check the folder and the free disk space");
}

namespace {

// OpenImageIO's messages may have several lines; Error messages have one.
std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

void write_image(const fs::path& file, const OIIO::ImageSpec& spec, const void* pixels, size_t row_stride) {
  StagedFile staged(file);
  auto out = OIIO::ImageOutput::create(file.string());
  if (!out || !out->open(staged.path().string(), spec) ||
      !out->write_image(spec.format, pixels, OIIO::AutoStride, static_cast<OIIO::stride_t>(row_stride)) ||
      !out->close())
    throw Error(file.string() + ": cannot be written: " + first_line(out ? out->geterror() : OIIO::geterror()));
  staged.commit();
}

}  // namespace

namespace {

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

void write_png(const fs::path& file, const cv::Mat& image) {
  const std::string bytes = png_bytes(image);
  StagedFile staged(file);
  write_text(staged.path(), bytes);
  staged.commit();
}

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
  const ExrImage exr = exr_image(channels, compression);
  write_image(file, exr.spec, exr.pixels.data, exr.pixels.step);
}

namespace {

uint32_t big_endian(const std::string& bytes, size_t at) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[at + i]);
  return value;
}

// True if all chunks of a PNG are complete (length, type, data, CRC of type and data). Checked here because libpng
// prints its own message on standard error.
bool is_whole_png(const std::string& bytes) {
  constexpr size_t kSignature = 8, kFrame = 12;
  for (size_t at = kSignature; at + kFrame <= bytes.size();) {
    const size_t length = big_endian(bytes, at);
    if (length > bytes.size() - at - kFrame) return false;
    const auto* type_and_data = reinterpret_cast<const Bytef*>(bytes.data()) + at + 4;
    if (crc32(0, type_and_data, static_cast<uInt>(length + 4)) != big_endian(bytes, at + 8 + length)) return false;
    if (bytes.compare(at + 4, 4, "IEND") == 0) return true;
    at += kFrame + length;
  }
  return false;
}

// Reads all channels as stored: unsigned 8 or 16 bits, or 32-bit float.
DecodedImage read_channels(std::unique_ptr<OIIO::ImageInput> in, const std::string& name) {
  if (!in) throw Error(name + ": cannot be read as an image: " + first_line(OIIO::geterror()));
  const OIIO::ImageSpec& spec = in->spec();
  if (spec.width < 1 || spec.height < 1 || spec.width > 16384 || spec.height > 16384)
    throw Error(name + ": invalid image size");
  if (spec.nchannels < 1 || spec.nchannels > CV_CN_MAX)
    throw Error(name + ": has " + std::to_string(spec.nchannels) + " channels; a camera image has one");
  const auto base = static_cast<OIIO::TypeDesc::BASETYPE>(spec.format.basetype);
  const int depth = base == OIIO::TypeDesc::UINT8 ? CV_8U : base == OIIO::TypeDesc::UINT16 ? CV_16U : CV_32F;
  cv::Mat image(spec.height, spec.width, CV_MAKETYPE(depth, spec.nchannels));
  const OIIO::TypeDesc wanted = depth == CV_32F ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : OIIO::TypeDesc(base);
  // For truncated TIFF or JPEG files read_image() succeeds and only sets an error message.
  if (!in->read_image(0, 0, 0, spec.nchannels, wanted, image.data) || in->has_error())
    throw Error(name + ": is truncated or damaged: " + first_line(in->geterror()));
  return {image, spec.channelnames};
}

OIIO::ImageSpec as_stored() {
  // Prevents OpenImageIO from premultiplying colours by alpha.
  OIIO::ImageSpec spec;
  spec.attribute("oiio:UnassociatedAlpha", 1);
  return spec;
}

cv::Mat read_image(const fs::path& file) {
  std::error_code ignored;
  if (!fs::exists(file, ignored)) throw Error(file.string() + ": is missing");
  if (file.extension() == ".png" && !is_whole_png(read_bytes(file)))
    throw Error(file.string() + ": is truncated or damaged; record or render it again");
  const OIIO::ImageSpec config = as_stored();
  return read_channels(OIIO::ImageInput::open(file.string(), &config), file.string()).image;
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
  const bool png = bytes.starts_with("\x89PNG");
  if (png && !is_whole_png(bytes)) throw Error(name + ": is truncated or damaged");
  OIIO::Filesystem::IOMemReader memory(const_cast<char*>(bytes.data()), bytes.size());
  OIIO::ImageSpec config = as_stored(), spec;
  void* proxy = &memory;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  auto in = OIIO::ImageInput::create(png ? "png" : "openexr");
  if (in && !in->open(png ? "memory.png" : "memory.exr", spec, config))
    throw Error(name + ": is not a PNG or EXR file, or damaged: " + first_line(in->geterror()));
  return read_channels(std::move(in), name);
}

cv::Mat read_grey(const fs::path& file) {
  cv::Mat image = read_image(file);
  if (image.channels() != 1)
    throw Error(file.string() + ": has " + std::to_string(image.channels()) + " channels; a camera image has one");
  return image;
}

cv::Mat read_as_grey(const fs::path& file, GreyFrom from) {
  const cv::Mat image = read_image(file);
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
