// SPDX-License-Identifier: Apache-2.0
// Atomic writing of files and folders, and image I/O through OpenImageIO.
#pragma once

#include <array>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/types/options.h"

namespace fringeslam {

// Folder that appears under its final name only when complete: it is written under a temporary name next to the target,
// renamed by commit(), and removed by the destructor if commit() was not called. An existing target is replaced only if
// it is empty or was written by this class with the same kind ("run", "dataset"); otherwise the constructor throws
// Error. With an empty kind, only an empty folder is replaced.
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

// File, with any accompanying files, that appears only when complete: all files are written under their final names
// into a temporary folder next to the target. commit() moves them into the target's folder, the target last; the
// destructor removes anything left over.
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

// Returns the file name's extension in lower case, with the dot.
std::string lower_extension(const std::filesystem::path& file);

// Reads a whole file; empty if it does not exist.
std::string read_bytes(const std::filesystem::path& file);

// PNG encoding to memory and to a file: CV_8UC1, CV_8UC3 (BGR, as in OpenCV) or CV_16UC1; compression level from 1
// (fast) to 9 (small).
std::string png_bytes(const cv::Mat& image, int compression = 1);
// PNG encoding of a gray image with camera noise: Huffman codes alone take two thirds of the time of a search for
// repetitions, which there are none of, and a tenth less space.
std::string noisy_png_bytes(const cv::Mat& image);
void write_png(const std::filesystem::path& file, const cv::Mat& image);

// JPEG encoding to memory; quality from 1 to 100.
std::string jpeg_bytes(const cv::Mat1b& image, int quality);

// EXR file with one or more CV_32FC1 channels of equal size. Run lengths compress only constant areas such as NaN, but
// noisy measurements hardly compress anyway, and writing takes an eighth of the time.
enum class ExrCompression { zip, run_lengths, none };
struct ExrChannel {
  std::string name;
  cv::Mat image;
};
std::string exr_bytes(const std::vector<ExrChannel>& channels, ExrCompression compression = ExrCompression::zip);
void write_exr(const std::filesystem::path& file, const std::vector<ExrChannel>& channels,
               ExrCompression compression = ExrCompression::zip);

// Decodes a PNG or EXR file in memory, with channels in the order of the file: unsigned 8 or 16 bits, or 32-bit float.
// `name` is used in messages. Throws Error if the bytes are truncated or damaged.
struct DecodedImage {
  cv::Mat image;                      // H x W, with any number of channels
  std::vector<std::string> channels;  // their names
};
DecodedImage decode_image(const std::string& bytes, const std::string& name);

// Reads a single-channel image: unsigned 8 or 16 bits (PNG, TIFF, BMP) or 32-bit float (EXR). Throws Error if the file
// is missing, truncated or has more than one channel.
cv::Mat read_grey(const std::filesystem::path& file);

enum class GreyFrom { luminance, red, green, blue };

constexpr auto choices(GreyFrom) {
  using enum GreyFrom;
  return std::to_array<Choice<GreyFrom>>({{luminance, "luminance"}, {red, "red"}, {green, "green"}, {blue, "blue"}});
}

// Reads an image that may be in colour and converts it to grey. Alpha is ignored. If red, green and blue are equal,
// they are the grey value; otherwise it is the selected channel or the rounded luminance 0.299 R + 0.587 G + 0.114 B
// (Rec. 601).
cv::Mat read_as_grey(const std::filesystem::path& file, GreyFrom from);

}  // namespace fringeslam
