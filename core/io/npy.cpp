// SPDX-License-Identifier: Apache-2.0
#include "core/io/npy.h"

#include <string>

#include "core/io/files.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

std::string dtype_of(const cv::Mat& image) {
  switch (image.type()) {
    case CV_8UC1:
      return "|u1";
    case CV_32SC1:
      return "<i4";
    case CV_32FC1:
      return "<f4";
    default:
      throw Error("write_npy: images must be CV_8UC1, CV_32SC1 or CV_32FC1");
  }
}

}  // namespace

void write_npy(const std::filesystem::path& file, const cv::Mat& image) {
  std::string header = "{'descr': '" + dtype_of(image) + "', 'fortran_order': False, 'shape': (" +
                       std::to_string(image.rows) + ", " + std::to_string(image.cols) + "), }";
  // Magic string, version, length of the header (2 bytes) and header, padded to a multiple of 64 bytes.
  constexpr size_t kPreamble = 10, kAlignment = 64;
  header.append(kAlignment - 1 - (kPreamble + header.size()) % kAlignment, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  const size_t row_bytes = static_cast<size_t>(image.cols) * image.elemSize();
  for (int row = 0; row < image.rows; ++row) bytes.append(reinterpret_cast<const char*>(image.ptr(row)), row_bytes);
  write_text(file, bytes);
}

}  // namespace fringeslam
