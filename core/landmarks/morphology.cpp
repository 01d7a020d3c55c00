// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/morphology.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace fringeslam {

namespace {

// Bit i is set where byte i, from the lowest, is not 0.
uint64_t bits_of_bytes(uint64_t bytes) {
  constexpr uint64_t kLow = 0x7f7f7f7f7f7f7f7f, kTop = 0x8080808080808080;
  const uint64_t set = (((bytes & kLow) + kLow) | bytes) & kTop;
  return set * 0x0002040810204081 >> 56;
}

}  // namespace

BitImage BitImage::from(const cv::Mat1b& mask) {
  static_assert(std::endian::native == std::endian::little);
  BitImage image(mask.cols, mask.rows);
  for (int r = 0; r < mask.rows; ++r) {
    const uchar* pixels = mask[r];
    uint64_t* words = image.row(r);
    int c = 0;
    for (; c + 8 <= mask.cols; c += 8) {
      uint64_t bytes;
      std::memcpy(&bytes, pixels + c, sizeof bytes);
      words[c / 64] |= bits_of_bytes(bytes) << (c % 64);
    }
    for (; c < mask.cols; ++c) words[c / 64] |= static_cast<uint64_t>(pixels[c] != 0) << (c % 64);
  }
  return image;
}

cv::Mat1b BitImage::mask() const {
  // Eight bytes for eight bits.
  static const std::array<uint64_t, 256> bytes_of = [] {
    std::array<uint64_t, 256> table{};
    for (size_t bits = 0; bits < table.size(); ++bits) {
      for (size_t i = 0; i < 8; ++i) table[bits] |= (bits >> i & 1) * (uint64_t{0xff} << (8 * i));
    }
    return table;
  }();
  cv::Mat1b mask(height_, width_);
  for (int r = 0; r < height_; ++r) {
    const uint64_t* words = row(r);
    uchar* pixels = mask[r];
    int c = 0;
    for (; c + 8 <= width_; c += 8) std::memcpy(pixels + c, &bytes_of[words[c / 64] >> (c % 64) & 0xff], 8);
    for (; c < width_; ++c) pixels[c] = words[c / 64] >> (c % 64) & 1 ? 255 : 0;
  }
  return mask;
}

namespace {

// The bits of the pixels' left or right neighbours.
inline uint64_t from_left(const uint64_t* row, int w) { return row[w] << 1 | (w > 0 ? row[w - 1] >> 63 : 0); }
inline uint64_t from_right(const uint64_t* row, int w, int words) {
  return row[w] >> 1 | (w + 1 < words ? row[w + 1] << 63 : 0);
}

// Which bits of the last word are pixels.
uint64_t last_word(int width) { return width % 64 == 0 ? ~uint64_t{0} : (uint64_t{1} << (width % 64)) - 1; }

// The rows above, of, and below a row; zeros beyond the border.
struct Rows {
  const uint64_t *above, *here, *below;
};
class Bordered {
 public:
  explicit Bordered(const BitImage& image) : image_(image), zeros_(static_cast<size_t>(image.words())) {}
  Rows around(int row) const {
    return {row > 0 ? image_.row(row - 1) : zeros_.data(), image_.row(row),
            row + 1 < image_.height() ? image_.row(row + 1) : zeros_.data()};
  }

 private:
  const BitImage& image_;
  std::vector<uint64_t> zeros_;
};

}  // namespace

BitImage dilated(const BitImage& image) {
  const int words = image.words();
  BitImage result(image.width(), image.height());
  if (words == 0) return result;
  const Bordered source(image);
  std::vector<uint64_t> column(static_cast<size_t>(words));
  const uint64_t last = last_word(image.width());
  for (int r = 0; r < image.height(); ++r) {
    const Rows rows = source.around(r);
    for (int w = 0; w < words; ++w) column[static_cast<size_t>(w)] = rows.above[w] | rows.here[w] | rows.below[w];
    uint64_t* out = result.row(r);
    for (int w = 0; w < words; ++w)
      out[w] = column[static_cast<size_t>(w)] | from_left(column.data(), w) | from_right(column.data(), w, words);
    out[words - 1] &= last;
  }
  return result;
}

// By bit quads (Gray 1971): 4 E = quads with one pixel - quads with three - 2 * diagonal quads.
int euler_number(const BitImage& image) {
  const int words = image.words();
  const std::vector<uint64_t> zeros(static_cast<size_t>(words));
  int sum = 0;
  for (int r = 0; r <= image.height(); ++r) {
    const uint64_t* above = r > 0 ? image.row(r - 1) : zeros.data();
    const uint64_t* below = r < image.height() ? image.row(r) : zeros.data();
    // Quads whose right column is the pixel's; the one behind the last column has it as its left.
    const auto count = [&](uint64_t a, uint64_t b, uint64_t c, uint64_t d) {
      const uint64_t odd = a ^ b ^ c ^ d;
      const uint64_t three = odd & ((a & b) | (c & d));
      const uint64_t diagonal = (a & d & ~b & ~c) | (b & c & ~a & ~d);
      sum += std::popcount(odd ^ three) - std::popcount(three) - 2 * std::popcount(diagonal);
    };
    for (int w = 0; w < words; ++w) count(from_left(above, w), above[w], from_left(below, w), below[w]);
    if (words > 0 && image.width() % 64 == 0) count(above[words - 1] >> 63, 0, below[words - 1] >> 63, 0);
  }
  return sum / 4;
}

Closing dilated_until_closed(const BitImage& image, int most) {
  Closing closing{image, 0};
  int least = euler_number(image);
  BitImage wide = image;
  for (int i = 1; i <= most; ++i) {
    wide = dilated(wide);
    const int euler = euler_number(wide);
    if (euler >= least) continue;
    least = euler;
    closing = {wide, i};
  }
  return closing;
}

namespace {

// A pixel's eight neighbours, 64 pixels at once, clockwise from north.
using Neighbours = std::array<uint64_t, 8>;

inline Neighbours neighbours(const Rows& rows, int w, int words) {
  return {rows.above[w],
          from_right(rows.above, w, words),
          from_right(rows.here, w, words),
          from_right(rows.below, w, words),
          rows.below[w],
          from_left(rows.below, w),
          from_left(rows.here, w),
          from_left(rows.above, w)};
}

// Golay's L, turned by 45 degrees times `turn`: three pixels of the background in a row, and opposite to them three of
// the foreground, or two where it is a corner.
template <int turn>
inline uint64_t hits(const Neighbours& n) {
  constexpr auto at = [](int i) { return static_cast<size_t>((i + turn) % 8); };
  if constexpr (turn % 2 == 0) return ~n[at(7)] & ~n[at(0)] & ~n[at(1)] & n[at(3)] & n[at(4)] & n[at(5)];
  // The corner's free sides, and the two that hold it together.
  return ~n[at(7)] & ~n[at(0)] & ~n[at(1)] & n[at(3)] & n[at(5)];
}

// Rows in which something may go: those beside which something went in the last round.
class ActiveRows {
 public:
  explicit ActiveRows(int rows)
      : active_(static_cast<size_t>(rows) + 2, 1), changed_(static_cast<size_t>(rows) + 2, 0) {}
  bool operator[](int row) const { return active_[static_cast<size_t>(row) + 1]; }
  void note(int row) {
    changed_[static_cast<size_t>(row) + 1] = 1;
    // For the rest of this round as well.
    for (int r = row; r <= row + 2; ++r) active_[static_cast<size_t>(r)] = 1;
  }
  // Whether there is anything to do in the next round.
  bool next_round() {
    bool any = false;
    for (size_t r = 1; r + 1 < active_.size(); ++r) {
      active_[r] = changed_[r - 1] | changed_[r] | changed_[r + 1];
      any |= active_[r] != 0;
    }
    std::fill(changed_.begin(), changed_.end(), char{0});
    return any;
  }

 private:
  std::vector<char> active_, changed_;  // with a row beyond either border
};

template <int turn>
void thin_once(BitImage& image, BitImage& removed, ActiveRows& active) {
  const int words = image.words(), height = image.height();
  const Bordered source(image);
  std::vector<int> rows_hit;
  for (int r = 0; r < height; ++r) {
    if (!active[r]) continue;
    const Rows rows = source.around(r);
    uint64_t* out = removed.row(r);
    uint64_t any = 0;
    for (int w = 0; w < words; ++w) {
      out[w] = rows.here[w] == 0 ? 0 : rows.here[w] & hits<turn>(neighbours(rows, w, words));
      any |= out[w];
    }
    if (any != 0) rows_hit.push_back(r);
  }
  for (const int r : rows_hit) {
    uint64_t* out = image.row(r);
    for (int w = 0; w < words; ++w) out[w] &= ~removed.row(r)[w];
    active.note(r);
  }
}

// Whether a pixel can go without joining or parting anything: of its neighbours there is one eight-connected set, and
// it is no line's end.
bool removable(const BitImage& image, int r, int c) {
  static constexpr std::array<int, 8> kRow = {-1, -1, 0, 1, 1, 1, 0, -1}, kCol = {0, 1, 1, 1, 0, -1, -1, -1};
  std::array<bool, 8> at;
  int count = 0, sets = 0;
  for (size_t i = 0; i < 8; ++i) count += at[i] = image.at(r + kRow[i], c + kCol[i]);
  for (size_t i = 0; i < 8; i += 2) sets += !at[i] && (at[i + 1] || at[(i + 2) % 8]);
  return sets == 1 && count > 1;
}

// The L leaves slanted lines two pixels wide: of each block of 2x2 a pixel that can go, goes.
void thin_blocks(BitImage& image, ActiveRows& active) {
  const int words = image.words();
  for (int r = 0; r + 1 < image.height(); ++r) {
    const uint64_t *here = image.row(r), *below = image.row(r + 1);
    for (int w = 0; w < words; ++w) {
      uint64_t blocks = here[w] & from_right(here, w, words) & below[w] & from_right(below, w, words);
      for (; blocks != 0; blocks &= blocks - 1) {
        const int c = 64 * w + std::countr_zero(blocks);
        // An earlier block may have lost a pixel of this one.
        if (!image.at(r, c) || !image.at(r, c + 1) || !image.at(r + 1, c) || !image.at(r + 1, c + 1)) continue;
        for (const auto& [row, col] : {std::pair(r, c), {r, c + 1}, {r + 1, c}, {r + 1, c + 1}}) {
          if (!removable(image, row, col)) continue;
          image.clear(row, col);
          active.note(row);
          break;
        }
      }
    }
  }
}

}  // namespace

BitImage thinned(BitImage image) {
  BitImage removed(image.width(), image.height());
  ActiveRows active(image.height());
  const auto round = [&]<int... turn>(std::integer_sequence<int, turn...>) {
    (thin_once<turn>(image, removed, active), ...);
    return active.next_round();
  };
  do {
    while (round(std::make_integer_sequence<int, 8>())) {
    }
    thin_blocks(image, active);
  } while (active.next_round());
  return image;
}

BitImage without_loose_ends(BitImage image) {
  struct Pixel {
    int row, col;
  };
  // The only neighbour where there is just one.
  const auto neighbours_of = [&](Pixel p, Pixel& only) {
    int count = 0;
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        if ((dr == 0 && dc == 0) || !image.at(p.row + dr, p.col + dc)) continue;
        only = {p.row + dr, p.col + dc};
        ++count;
      }
    }
    return count;
  };
  std::vector<Pixel> edge;
  image.for_each([&](int r, int c) { edge.push_back({r, c}); });
  for (Pixel pixel : edge) {
    Pixel next{};
    for (; image.at(pixel.row, pixel.col); pixel = next) {
      const int count = neighbours_of(pixel, next);
      if (count > 1) break;
      image.clear(pixel.row, pixel.col);
      if (count == 0) break;
    }
  }
  return image;
}

}  // namespace fringeslam
