// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/morphology.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>

#include "core/base/parallel.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

// Sets bit i where byte i, counted from the lowest, is not 0.
uint64_t bits_of_bytes(uint64_t bytes) {
  constexpr uint64_t kLow = 0x7f7f7f7f7f7f7f7f, kTop = 0x8080808080808080;
  const uint64_t set = (((bytes & kLow) + kLow) | bytes) & kTop;
  return set * 0x0002040810204081 >> 56;
}

}  // namespace

BitImage BitImage::from(const cv::Mat1b& mask, uchar bits) {
  const uint64_t wanted = uint64_t{bits} * 0x0101010101010101;
  static_assert(std::endian::native == std::endian::little);
  BitImage image(mask.cols, mask.rows);
  for_each_row(mask.rows, [&](int r) {
    const uchar* pixels = mask[r];
    uint64_t* words = image.row(r);
    int c = 0;
    for (; c + 8 <= mask.cols; c += 8) {
      uint64_t bytes;
      std::memcpy(&bytes, pixels + c, sizeof bytes);
      words[c / 64] |= bits_of_bytes(bytes & wanted) << (c % 64);
    }
    for (; c < mask.cols; ++c) words[c / 64] |= static_cast<uint64_t>((pixels[c] & bits) != 0) << (c % 64);
  });
  return image;
}

cv::Mat1b BitImage::mask() const {
  // Eight bytes for each combination of eight bits.
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

// Bits of the left or right neighbours.
FRINGESLAM_INLINE uint64_t from_left(const uint64_t* word) { return word[0] << 1 | word[-1] >> 63; }
FRINGESLAM_INLINE uint64_t from_right(const uint64_t* word) { return word[0] >> 1 | word[1] << 63; }

// Bits of the eight neighbours, clockwise from north.
FRINGESLAM_INLINE std::array<uint64_t, 8> neighbour_words(const uint64_t* here, std::ptrdiff_t stride) {
  const uint64_t *above = here - stride, *below = here + stride;
  return {above[0], from_right(above), from_right(here), from_right(below),
          below[0], from_left(below),  from_left(here),  from_left(above)};
}

// Bits of the last word that are pixels.
uint64_t last_word(int width) { return width % 64 == 0 ? ~uint64_t{0} : (uint64_t{1} << (width % 64)) - 1; }

}  // namespace

BitImage dilated(const BitImage& image) {
  const int words = image.words(), stride = image.stride();
  BitImage result(image.width(), image.height());
  if (words == 0) return result;
  const uint64_t last = last_word(image.width());
  std::vector<uint64_t> column(static_cast<size_t>(words) + 2);
  for (int r = 0; r < image.height(); ++r) {
    const uint64_t* here = image.row(r);
    uint64_t *out = result.row(r), *high = column.data() + 1;
    for (int w = 0; w < words; ++w) high[w] = here[w - stride] | here[w] | here[w + stride];
    for (int w = 0; w < words; ++w) out[w] = high[w] | from_left(high + w) | from_right(high + w);
    out[words - 1] &= last;
  }
  return result;
}

namespace {

// Spreads seeds along the mask's runs within one word, in both directions (Kogge-Stone).
uint64_t spread(uint64_t seeds, uint64_t mask) {
  uint64_t up = mask, down = mask;
  for (int shift = 1; shift < 64; shift *= 2) {
    seeds |= (up & seeds << shift) | (down & seeds >> shift);
    up &= up << shift;
    down &= down >> shift;
  }
  return seeds & mask;
}

// Spreads set pixels within the mask from row `from` into `row` and along the row; returns whether any were added.
bool spread_row(BitImage& set, const BitImage& mask, int row, int from) {
  const uint64_t *allowed = mask.row(row), *before = set.row(from);
  uint64_t *out = set.row(row), added = 0;
  for (const int step : {1, -1}) {
    for (int i = 0, w = step > 0 ? 0 : mask.words() - 1; i < mask.words(); ++i, w += step) {
      if (allowed[w] == 0) continue;
      const uint64_t beside = before[w] | from_left(before + w) | from_right(before + w) | from_left(out + w) |
                              from_right(out + w) | out[w];
      const uint64_t filled = (beside & allowed[w]) == out[w] ? out[w] : spread(beside & allowed[w], allowed[w]);
      added |= filled ^ out[w];
      out[w] = filled;
    }
  }
  return added != 0;
}

}  // namespace

BitImage reconstructed(const BitImage& seeds, const BitImage& mask) {
  BitImage set = seeds;
  set &= mask;
  for (bool changed = true; changed;) {
    changed = false;
    for (int r = 0; r < mask.height(); ++r) changed |= spread_row(set, mask, r, r - 1);
    for (int r = mask.height() - 1; r >= 0; --r) changed |= spread_row(set, mask, r, r + 1);
  }
  return set;
}

namespace {

// Returns 4 E by bit quads (Gray 1971), i.e. quads with one pixel minus those with three minus twice the diagonal
// ones, of the quads whose lower right pixels are in these words; the words above them are read too.
FRINGESLAM_INLINE int quads_body(const uint64_t* words, std::ptrdiff_t stride, std::ptrdiff_t count) {
  int sum = 0;
  for (const uint64_t* below = words; below != words + count; ++below) {
    const uint64_t* above = below - stride;
    const uint64_t a = from_left(above), b = above[0], c = from_left(below), d = below[0];
    const uint64_t odd = a ^ b ^ c ^ d;
    const uint64_t three = odd & ((a & b) | (c & d));
    const uint64_t diagonal = (a & d & ~b & ~c) | (b & c & ~a & ~d);
    sum += std::popcount(odd ^ three) - std::popcount(three) - 2 * std::popcount(diagonal);
  }
  return sum;
}

}  // namespace

int euler_number(const BitImage& image) {
  static const auto quads = Variants<quads_body>::of(selected_instruction_set());
  // Includes the row below the image and the zero words between rows, which hold the quads right of the last column.
  return quads(image.row(0), image.stride(), std::ptrdiff_t{image.stride()} * (image.height() + 1)) / 4;
}

Closing close_gaps(const BitImage& image, int most) {
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

// Finds the hits of Golay's L rotated by 45 degrees times `turn`: three background pixels in a row and, opposite to
// them, three foreground pixels (two for a corner). Writes the hits of a run of words.
template <int turn>
FRINGESLAM_INLINE void hits_body(const uint64_t* image, std::ptrdiff_t stride, std::ptrdiff_t count,
                                 uint64_t* __restrict hit) {
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const auto n = neighbour_words(image + i, stride);
    const uint64_t free = ~(n[(7 + turn) % 8] | n[turn % 8] | n[(1 + turn) % 8]);
    uint64_t held = n[(3 + turn) % 8] & n[(5 + turn) % 8];
    // At a corner the two sides alone keep the neighbours connected.
    if constexpr (turn % 2 == 0) held &= n[(4 + turn) % 8];
    hit[i] = image[i] & free & held;
  }
}

// Rows in which pixels may still be removed: those next to a change in the last round.
class ActiveRows {
 public:
  explicit ActiveRows(int rows)
      : active_(static_cast<size_t>(rows) + 2, 1), changed_(static_cast<size_t>(rows) + 2, 0) {}
  std::vector<cv::Range> runs() const {
    std::vector<cv::Range> runs;
    for (int r = 0; r + 2 < static_cast<int>(active_.size()); ++r) {
      if (!active_[static_cast<size_t>(r) + 1]) continue;
      if (runs.empty() || runs.back().end < r) runs.emplace_back(r, r);
      runs.back().end = r + 1;
    }
    return runs;
  }
  void note(int row) {
    changed_[static_cast<size_t>(row) + 1] = 1;
    // Activates the rows for the rest of this round as well.
    for (int r = row; r <= row + 2; ++r) active_[static_cast<size_t>(r)] = 1;
  }
  // Starts the next round; returns whether any row is active.
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
  std::vector<char> active_, changed_;  // including one row beyond either border
};

template <int turn>
void thin_once(BitImage& image, BitImage& hit, ActiveRows& active) {
  static const auto find_hits = Variants<hits_body<turn>>::of(selected_instruction_set());
  const int stride = image.stride();
  const std::vector<cv::Range> runs = active.runs();
  for (const cv::Range& rows : runs)
    find_hits(image.row(rows.start), stride, std::ptrdiff_t{stride} * rows.size(), hit.row(rows.start));
  for (const cv::Range& rows : runs) {
    for (int r = rows.start; r < rows.end; ++r) {
      uint64_t *row = image.row(r), any = 0;
      const uint64_t* gone = hit.row(r);
      for (int w = 0; w < stride; ++w) any |= gone[w];
      if (any == 0) continue;
      for (int w = 0; w < stride; ++w) row[w] &= ~gone[w];
      active.note(r);
    }
  }
}

// True if removing the pixel neither joins nor splits anything: its neighbours form one 8-connected set and it is not
// the end of a line.
bool removable(const BitImage& image, int r, int c) {
  static constexpr std::array<int, 8> kRow = {-1, -1, 0, 1, 1, 1, 0, -1}, kCol = {0, 1, 1, 1, 0, -1, -1, -1};
  std::array<bool, 8> at;
  int count = 0, sets = 0;
  for (size_t i = 0; i < 8; ++i) count += at[i] = image.at(r + kRow[i], c + kCol[i]);
  for (size_t i = 0; i < 8; i += 2) sets += !at[i] && (at[i + 1] || at[(i + 2) % 8]);
  return sets == 1 && count > 1;
}

// The L leaves slanted lines two pixels wide: removes one removable pixel from each 2x2 block.
void thin_blocks(BitImage& image, ActiveRows& active) {
  const int words = image.words();
  for (int r = 0; r + 1 < image.height(); ++r) {
    const uint64_t *here = image.row(r), *below = image.row(r + 1);
    for (int w = 0; w < words; ++w) {
      uint64_t blocks = here[w] & from_right(here + w) & below[w] & from_right(below + w);
      for (; blocks != 0; blocks &= blocks - 1) {
        const int c = 64 * w + std::countr_zero(blocks);
        // A previous block may have lost a pixel of this one.
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

BitImage remove_open_lines(BitImage image) {
  struct Pixel {
    int row, col;
  };
  // Counts the neighbours; `only` is the neighbour if there is exactly one.
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
  // Start points: pixels with fewer than two neighbours, found 64 at a time.
  BitImage ends(image.width(), image.height());
  const int stride = image.stride();
  for (int r = 0; r < image.height(); ++r) {
    for (int w = 0; w < image.words(); ++w) {
      const uint64_t* here = image.row(r) + w;
      uint64_t one = 0, two = 0;
      for (const uint64_t n : neighbour_words(here, stride)) {
        two |= one & n;
        one |= n;
      }
      ends.row(r)[w] = here[0] & ~two;
    }
  }
  std::vector<Pixel> begin;
  ends.for_each([&](int r, int c) { begin.push_back({r, c}); });
  for (Pixel pixel : begin) {
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
