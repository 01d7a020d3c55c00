// SPDX-License-Identifier: Apache-2.0
// Files and folders written whole or not at all, and images through OpenImageIO.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace fringeslam {

// A folder under construction: lives under a temporary name beside its target, is renamed to it by
// commit() and removed by the destructor when commit() was never reached. An existing target is replaced only
// when it is empty or was put in place by us as the same kind of thing ("run", "dataset"); otherwise the
// constructor throws. Without a kind nothing but an empty folder is ever replaced.
class StagedFolder {
 public:
  StagedFolder(std::filesystem::path target, std::string kind);
  ~StagedFolder();
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;

  const std::filesystem::path& path() const { return staging_; }
  void commit();

 private:
  std::filesystem::path target_, staging_;
  std::string kind_;
  bool committed_ = false;
};

// A file, and others that belong beside it, under construction: they are written under their own names into a temporary
// folder beside the target. commit() moves them to the target's folder, the target last; what never got there is
// removed by the destructor.
class StagedFile {
 public:
  explicit StagedFile(std::filesystem::path target);
  ~StagedFile();
  StagedFile(const StagedFile&) = delete;
  StagedFile& operator=(const StagedFile&) = delete;

  std::filesystem::path path() const { return staging_ / target_.filename(); }
  void commit();

 private:
  std::filesystem::path target_, staging_;
};

void write_text(const std::filesystem::path& file, const std::string& text);

// The whole file; empty when there is none.
std::string read_bytes(const std::filesystem::path& file);

// A PNG file's bytes, and the file. CV_8UC1, CV_8UC3 (BGR, as OpenCV keeps it) or CV_16UC1; compression from 1 (fast) to
// 9 (small).
std::string png_bytes(const cv::Mat& image, int compression = 3);
void write_png(const std::filesystem::path& file, const cv::Mat& image);

// A JPEG file's bytes, of CV_8UC1; quality from 1 to 100.
std::string jpeg_bytes(const cv::Mat1b& image, int quality);

// One or more CV_32FC1 channels of one size, zip-compressed.
struct ExrChannel {
  std::string name;
  cv::Mat image;
};
void write_exr(const std::filesystem::path& file, const std::vector<ExrChannel>& channels);

// One channel of unsigned 8 or 16 bits (PNG, TIFF, BMP) or 32-bit float (EXR). Throws Error when the
// file is missing, truncated, or has another number of channels.
cv::Mat read_grey(const std::filesystem::path& file);

enum class GreyFrom { luminance, red, green, blue };

// The same of a file that may be in colour, then 8 or 16 bits. Alpha is ignored; where red, green and blue are equal
// they are the grey value; else it is the channel asked for, or the luminance 0.299 R + 0.587 G + 0.114 B (Rec. 601),
// rounded.
cv::Mat read_as_grey(const std::filesystem::path& file, GreyFrom from);

}  // namespace fringeslam
