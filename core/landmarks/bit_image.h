// SPDX-License-Identifier: Apache-2.0
// Binary images with 64 pixels per word, for morphology (docs/method.md, section 5.1). A word holds pixels of one row,
// the least significant bit being the leftmost. Pixels beyond the border are 0. A zero word separates rows, precedes the
// first and follows the last, and a zero row lies above and below the image, so that the neighbours of every word can be
// read and several rows can be processed as one run of words.
#pragma once

#include <bit>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

class BitImage {
 public:
  BitImage(int width, int height)
      : width_(width),
        height_(height),
        words_((width + 63) / 64),
        bits_(2 + static_cast<size_t>(words_ + 1) * static_cast<size_t>(height + 2)) {}

  // Sets every pixel whose mask value contains any of `bits`.
  static BitImage from(const cv::Mat1b& mask, uchar bits = 255);
  // Returns 255 where a pixel is set, else 0.
  cv::Mat1b mask() const;

  int width() const { return width_; }
  int height() const { return height_; }
  int words() const { return words_; }       // per row
  int stride() const { return words_ + 1; }  // words between rows
  // Row index in [-1, height].
  uint64_t* row(int row) { return bits_.data() + offset(row); }
  const uint64_t* row(int row) const { return bits_.data() + offset(row); }

  bool at(int row, int col) const {
    return row >= 0 && col >= 0 && row < height_ && col < width_ && (this->row(row)[col / 64] >> (col % 64) & 1);
  }
  void set(int row, int col) { this->row(row)[col / 64] |= uint64_t{1} << (col % 64); }
  void clear(int row, int col) { this->row(row)[col / 64] &= ~(uint64_t{1} << (col % 64)); }

  // Calls visit(row, col) for every set pixel in row-major order.
  template <class Visit>
  void for_each(const Visit& visit) const {
    for (int r = 0; r < height_; ++r) {
      for (int w = 0; w < words_; ++w) {
        for (uint64_t left = row(r)[w]; left != 0; left &= left - 1) visit(r, 64 * w + std::countr_zero(left));
      }
    }
  }

  BitImage& operator&=(const BitImage& other) {
    for (size_t i = 0; i < bits_.size(); ++i) bits_[i] &= other.bits_[i];
    return *this;
  }
  bool operator==(const BitImage&) const = default;

 private:
  size_t offset(int row) const { return 1 + static_cast<size_t>(row + 1) * static_cast<size_t>(words_ + 1); }

  int width_ = 0, height_ = 0, words_ = 0;
  std::vector<uint64_t> bits_;
};

}  // namespace fringeslam
