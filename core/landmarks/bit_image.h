// SPDX-License-Identifier: Apache-2.0
// Binary images of 64 pixels a word, for morphology (METHOD S8-S10): a word holds pixels of one row, the least bit the
// leftmost. Pixels beyond the border are 0. There is a word of zeros between rows and a row of zeros above and below
// the image, so that neighbours of every word can be read, and many rows as one run of words.
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
        bits_(static_cast<size_t>(words_ + 1) * static_cast<size_t>(height + 2)) {}

  // Every pixel in which one of these bits is set.
  static BitImage from(const cv::Mat1b& mask, uchar bits = 255);
  // 255 where a bit is set.
  cv::Mat1b mask() const;

  int width() const { return width_; }
  int height() const { return height_; }
  int words() const { return words_; }       // of a row
  int stride() const { return words_ + 1; }  // from row to row
  // Of [-1, height].
  uint64_t* row(int row) { return bits_.data() + offset(row); }
  const uint64_t* row(int row) const { return bits_.data() + offset(row); }

  bool at(int row, int col) const {
    return row >= 0 && col >= 0 && row < height_ && col < width_ && (this->row(row)[col / 64] >> (col % 64) & 1);
  }
  void set(int row, int col) { this->row(row)[col / 64] |= uint64_t{1} << (col % 64); }
  void clear(int row, int col) { this->row(row)[col / 64] &= ~(uint64_t{1} << (col % 64)); }

  // Calls visit(row, col) for every set pixel, in the order of rows and columns.
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
  size_t offset(int row) const { return static_cast<size_t>(row + 1) * static_cast<size_t>(words_ + 1); }

  int width_ = 0, height_ = 0, words_ = 0;
  std::vector<uint64_t> bits_;
};

}  // namespace fringeslam
