// SPDX-License-Identifier: Apache-2.0
// A file in memory, mapped for reading, and images that lie in it: only what is used is read, and the kernel may drop it
// again. The file must keep its size while it is mapped: reading beyond its end would end the process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string_view>

namespace fringeslam {

class MappedFile : public std::enable_shared_from_this<MappedFile> {
 public:
  // Maps `size` bytes of an open file; keeps a copy of the descriptor. Throws std::bad_alloc if that is not possible.
  MappedFile(int descriptor, uint64_t size);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  int descriptor() const { return descriptor_; }
  std::string_view bytes() const { return {data_, size_}; }
  // Position of an address in the file; empty if it is elsewhere.
  std::optional<uint64_t> offset_of(const void* address) const;

  // Image whose pixels lie in the file, row after row without gaps, and must not be written. It keeps the mapping. The
  // file must have so many bytes.
  template <class Pixel>
  cv::Mat_<Pixel> image(uint64_t offset, cv::Size size) const {
    return image(offset, size, cv::traits::Type<Pixel>::value);
  }

  // Lets the kernel read a part ahead of its use.
  void prefetch(uint64_t offset, uint64_t bytes) const;
  // Lets the kernel drop what was read.
  void release() const;

 private:
  cv::Mat image(uint64_t offset, cv::Size size, int type) const;

  int descriptor_;
  char* data_ = nullptr;
  size_t size_;
};

}  // namespace fringeslam
