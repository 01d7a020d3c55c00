// SPDX-License-Identifier: Apache-2.0
#include "core/rig/files.h"

#include <OpenImageIO/imageio.h>

#include <fstream>

#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

StagedFolder::StagedFolder(fs::path target, const std::string& marker) : target_(std::move(target)) {
  if (target_.filename().empty()) target_ = target_.parent_path();
  std::error_code failed;
  if (fs::exists(target_, failed) && !fs::exists(target_ / marker, failed) &&
      !(fs::is_directory(target_, failed) && fs::is_empty(target_, failed)))
    throw Error(target_.string() + ": exists and was not written by fringeslam (no " + marker +
                " in it); choose another --out");
  staging_ = target_;
  staging_ += ".partial";
  fs::remove_all(staging_, failed);
  fs::create_directories(staging_, failed);
  if (failed) throw Error(staging_.string() + ": cannot be created: " + failed.message());
}

StagedFolder::~StagedFolder() {
  std::error_code ignored;
  if (!committed_) fs::remove_all(staging_, ignored);
}

void StagedFolder::commit() {
  std::error_code failed;
  // The old result steps aside first, so that a failed rename never costs both.
  fs::path old = target_;
  old += ".old";
  fs::remove_all(old, failed);
  const bool existed = fs::exists(target_, failed);
  if (existed) fs::rename(target_, old, failed);
  if (!failed) fs::rename(staging_, target_, failed);
  if (failed) throw Error(target_.string() + ": cannot be put in place: " + failed.message());
  committed_ = true;
  fs::remove_all(old, failed);
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(file.string() + ": cannot be written; check the folder and the space left on the disk");
}

namespace {

void write_image(const fs::path& file, const OIIO::ImageSpec& spec, const void* pixels, size_t row_stride) {
  auto out = OIIO::ImageOutput::create(file.string());
  if (!out || !out->open(file.string(), spec) ||
      !out->write_image(spec.format, pixels, OIIO::AutoStride, static_cast<OIIO::stride_t>(row_stride)) ||
      !out->close())
    throw Error(file.string() + ": cannot be written: " + (out ? out->geterror() : OIIO::geterror()));
}

}  // namespace

void write_png(const fs::path& file, const cv::Mat& image) {
  cv::Mat pixels = image;
  if (image.type() == CV_8UC3) {  // OpenCV's BGR -> the file's RGB
    pixels = cv::Mat(image.size(), CV_8UC3);
    cv::mixChannels(image, pixels, {0, 2, 1, 1, 2, 0});
  }
  const OIIO::TypeDesc type = image.depth() == CV_16U ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8;
  OIIO::ImageSpec spec(image.cols, image.rows, image.channels(), type);
  spec.attribute("png:compressionLevel", 3);
  write_image(file, spec, pixels.data, pixels.step);
}

void write_exr(const fs::path& file, const std::vector<ExrChannel>& channels) {
  std::vector<cv::Mat> planes;
  for (const ExrChannel& channel : channels) planes.push_back(channel.image);
  cv::Mat pixels;
  cv::merge(planes, pixels);
  OIIO::ImageSpec spec(pixels.cols, pixels.rows, pixels.channels(), OIIO::TypeDesc::FLOAT);
  spec.channelnames.clear();
  for (const ExrChannel& channel : channels) spec.channelnames.push_back(channel.name);
  spec.attribute("compression", "zips");
  write_image(file, spec, pixels.data, pixels.step);
}

cv::Mat read_grey(const fs::path& file) {
  std::error_code ignored;
  if (!fs::exists(file, ignored)) throw Error(file.string() + ": is missing");
  auto in = OIIO::ImageInput::open(file.string());
  if (!in) throw Error(file.string() + ": cannot be read as an image: " + OIIO::geterror());
  const OIIO::ImageSpec& spec = in->spec();
  if (spec.nchannels != 1)
    throw Error(file.string() + ": has " + std::to_string(spec.nchannels) + " channels; a camera image has one");
  if (spec.width < 1 || spec.height < 1 || spec.width > 16384 || spec.height > 16384)
    throw Error(file.string() + ": impossible image size");
  const auto base = static_cast<OIIO::TypeDesc::BASETYPE>(spec.format.basetype);
  const int type = base == OIIO::TypeDesc::UINT8 ? CV_8UC1 : base == OIIO::TypeDesc::UINT16 ? CV_16UC1 : CV_32FC1;
  cv::Mat image(spec.height, spec.width, type);
  const OIIO::TypeDesc wanted = type == CV_32FC1 ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : OIIO::TypeDesc(base);
  if (!in->read_image(0, 0, 0, 1, wanted, image.data))
    throw Error(file.string() + ": is truncated or damaged: " + in->geterror());
  return image;
}

}  // namespace fringeslam
