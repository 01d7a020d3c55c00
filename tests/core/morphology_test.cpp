// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/morphology.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::Random;

BitImage image_of(const std::vector<std::string>& rows) {
  BitImage image(static_cast<int>(rows[0].size()), static_cast<int>(rows.size()));
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < rows[r].size(); ++c) {
      if (rows[r][c] == '1') image.set(static_cast<int>(r), static_cast<int>(c));
    }
  }
  return image;
}

std::vector<std::string> rows_of(const BitImage& image) {
  std::vector<std::string> rows(static_cast<size_t>(image.height()),
                                std::string(static_cast<size_t>(image.width()), '0'));
  image.for_each([&](int r, int c) { rows[static_cast<size_t>(r)][static_cast<size_t>(c)] = '1'; });
  return rows;
}

// Random discs and rings, some of which touch the border or span words.
BitImage random_shapes(uint64_t seed, int width = 150, int height = 90) {
  Random random(seed);
  BitImage image(width, height);
  for (int i = 0; i < 14; ++i) {
    const double x = random.uniform(0, width), y = random.uniform(0, height), radius = random.uniform(0.5, 9);
    const double hole = random.uniform(0, 1) < 0.4 ? radius * 0.5 : -1;
    for (int r = 0; r < height; ++r) {
      for (int c = 0; c < width; ++c) {
        const double distance = std::hypot(c - x, r - y);
        if (distance <= radius && distance > hole) image.set(r, c);
      }
    }
  }
  return image;
}

BitImage random_specks(uint64_t seed, double density, int width = 131, int height = 47) {
  Random random(seed);
  BitImage image(width, height);
  for (int r = 0; r < height; ++r) {
    for (int c = 0; c < width; ++c) {
      if (random.uniform(0, 1) < density) image.set(r, c);
    }
  }
  return image;
}

int neighbours(const BitImage& image, int r, int c) {
  int count = 0;
  for (int dr = -1; dr <= 1; ++dr) {
    for (int dc = -1; dc <= 1; ++dc) count += (dr || dc) && image.at(r + dr, c + dc);
  }
  return count;
}

// Counts connected components by flood fill: 8-connected foreground, or 4-connected background including everything
// beyond the border.
int components(const BitImage& image, bool foreground) {
  const int width = image.width() + 2, height = image.height() + 2;
  std::vector<char> seen(static_cast<size_t>(width * height), 0);
  int count = 0;
  for (int start = 0; start < width * height; ++start) {
    const auto is = [&](int r, int c) { return image.at(r - 1, c - 1) == foreground; };
    if (seen[static_cast<size_t>(start)] || !is(start / width, start % width)) continue;
    ++count;
    std::vector<int> open = {start};
    seen[static_cast<size_t>(start)] = 1;
    while (!open.empty()) {
      const int at = open.back();
      open.pop_back();
      for (int dr = -1; dr <= 1; ++dr) {
        for (int dc = -1; dc <= 1; ++dc) {
          const int r = at / width + dr, c = at % width + dc;
          if ((!foreground && dr && dc) || r < 0 || c < 0 || r >= height || c >= width) continue;
          const auto next = static_cast<size_t>(r * width + c);
          if (seen[next] || !is(r, c)) continue;
          seen[next] = 1;
          open.push_back(static_cast<int>(next));
        }
      }
    }
  }
  return count;
}
int holes(const BitImage& image) { return components(image, false) - 1; }

// True if the pixel can be removed without joining or splitting anything (crossing number one) and is not a line end.
bool removable(const BitImage& image, int r, int c) {
  static constexpr int kRow[] = {-1, -1, 0, 1, 1, 1, 0, -1}, kCol[] = {0, 1, 1, 1, 0, -1, -1, -1};
  const auto at = [&](int i) { return image.at(r + kRow[i % 8], c + kCol[i % 8]); };
  int sets = 0;  // 8-connected sets of neighbours separated by 4-connected background
  for (int i = 0; i < 8; i += 2) sets += !at(i) && (at(i + 1) || at(i + 2));
  return sets == 1 && neighbours(image, r, c) > 1;
}

// Thesis Fig. 3-4.
const std::vector<std::string> kBefore = {
    "0000000000000000", "0000000000000000", "0000111100000000", "0001111100000000",
    "0001100000000000", "0000000000000000", "0000001100000000", "0000001000000000",
    "0000001100000000", "0000001110100000", "0000000111111000", "0000000011100000",
    "0000000001100000", "0000000001000000", "0000000000000000", "0000000000000000"};

TEST(Morphology, DilatesAsTheWorkedExampleOfTheThesis) {
  const std::vector<std::string> after = {
      "0000000000000000", "0001111110000000", "0011111110000000", "0011111110000000",
      "0011111110000000", "0011111110000000", "0000011110000000", "0000011110000000",
      "0000011111110000", "0000011111111100", "0000011111111100", "0000001111111100",
      "0000000111110000", "0000000011110000", "0000000011100000", "0000000000000000"};
  EXPECT_EQ(rows_of(dilated(image_of(kBefore))), after);
}

TEST(Morphology, DilationIsTheUnionOfShiftedImages) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    const BitImage image = random_specks(seed, 0.05, 64 + static_cast<int>(seed), 20);
    const BitImage wide = dilated(image);
    for (int r = 0; r < image.height(); ++r) {
      for (int c = 0; c < image.width(); ++c)
        ASSERT_EQ(wide.at(r, c), image.at(r, c) || neighbours(image, r, c) > 0) << r << " " << c;
    }
  }
}

TEST(Morphology, ReconstructionKeepsComponentsWithASeed) {
  for (uint64_t seed = 1; seed <= 12; ++seed) {
    const BitImage mask =
        seed % 2 ? thinned(random_shapes(seed, 200)) : random_specks(seed, 0.03 * static_cast<double>(seed));
    const BitImage seeds = random_specks(seed + 100, 0.01, mask.width(), mask.height());
    cv::Mat labels;
    cv::connectedComponents(mask.mask(), labels, 8, CV_32S);
    std::set<int> seeded;
    mask.for_each([&](int r, int c) {
      if (seeds.at(r, c)) seeded.insert(labels.at<int>(r, c));
    });
    const BitImage kept = reconstructed(seeds, mask);
    for (int r = 0; r < mask.height(); ++r) {
      for (int c = 0; c < mask.width(); ++c)
        ASSERT_EQ(kept.at(r, c), mask.at(r, c) && seeded.contains(labels.at<int>(r, c)))
            << seed << ": " << r << " " << c;
    }
  }
}

TEST(Morphology, EulerNumberIsComponentsLessHoles) {
  for (uint64_t seed = 1; seed <= 30; ++seed) {
    const BitImage image = seed % 2 ? random_shapes(seed, 128) : random_specks(seed, 0.02 * static_cast<double>(seed));
    EXPECT_EQ(euler_number(image), components(image, true) - holes(image)) << seed;
  }
}

TEST(Morphology, ClosesAGapAndStops) {
  // A square ring with a gap of three pixels, which two dilations close.
  std::vector<std::string> rows(40, std::string(40, '0'));
  for (size_t i = 10; i < 30; ++i) rows[10][i] = rows[29][i] = rows[i][10] = rows[i][29] = '1';
  for (size_t i = 18; i < 21; ++i) rows[10][i] = '0';
  const Closing closing = close_gaps(image_of(rows), 10);
  EXPECT_EQ(holes(closing.image), 1);
  EXPECT_EQ(closing.dilations, 2);
  EXPECT_EQ(close_gaps(image_of(rows), 1).dilations, 0);
  // Nothing to close, so nothing is dilated.
  EXPECT_EQ(close_gaps(closing.image, 10).dilations, 0);
}

TEST(Morphology, ThinningKeepsWhatIsConnected) {
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    const BitImage image = random_shapes(seed);
    const BitImage thin = thinned(image);
    EXPECT_EQ(components(thin, true), components(image, true)) << seed;
    EXPECT_EQ(holes(thin), holes(image)) << seed;
    thin.for_each([&](int r, int c) { EXPECT_TRUE(image.at(r, c)); });
    EXPECT_EQ(thinned(thin), thin) << "is not idempotent";
  }
}

TEST(Morphology, ThinningLeavesOnePixel) {
  int blocks = 0;
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    const BitImage thin = thinned(random_shapes(seed));
    thin.for_each([&](int r, int c) {
      if (!thin.at(r, c + 1) || !thin.at(r + 1, c) || !thin.at(r + 1, c + 1)) return;
      ++blocks;
      // Where four lines meet at the corners of a 2x2 block, none of its pixels can be removed.
      for (const auto& [dr, dc] : {std::pair(0, 0), {0, 1}, {1, 0}, {1, 1}})
        EXPECT_FALSE(removable(thin, r + dr, c + dc)) << seed << ": " << r + dr << " " << c + dc;
    });
  }
  EXPECT_LE(blocks, 2);
}

TEST(Morphology, ThinsABarToItsMiddle) {
  const BitImage thin =
      thinned(image_of({"0000000000000", "0111111111110", "0111111111110", "0111111111110", "0000000000000"}));
  for (int c = 3; c <= 9; ++c) {
    EXPECT_TRUE(thin.at(2, c));
    EXPECT_FALSE(thin.at(1, c) || thin.at(3, c));
  }
}

TEST(Morphology, NothingLooseIsLeft) {
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    const BitImage edges = seed % 2 ? thinned(random_shapes(seed)) : random_specks(seed, 0.12);
    const BitImage clean = remove_open_lines(edges);
    clean.for_each([&](int r, int c) { EXPECT_GE(neighbours(clean, r, c), 2) << seed; });
    EXPECT_EQ(remove_open_lines(clean), clean);
    // The largest such set is unique, so repeated passes over the whole image must find the same.
    BitImage slow = edges;
    for (bool changed = true; changed;) {
      changed = false;
      BitImage next = slow;
      slow.for_each([&](int r, int c) {
        if (neighbours(slow, r, c) < 2) next.clear(r, c), changed = true;
      });
      slow = next;
    }
    EXPECT_EQ(clean, slow) << seed;
  }
}

TEST(Morphology, ALineDisappearsAndARingStays) {
  const BitImage clean = remove_open_lines(image_of({"000000000000", "011100001110", "010111111010", "011100001110",
                                                     "000000000000", "010101111110", "000000000000"}));
  EXPECT_EQ(rows_of(clean), (std::vector<std::string>{"000000000000", "011100001110", "010111111010", "011100001110",
                                                      "000000000000", "000000000000", "000000000000"}));
}

TEST(Morphology, ImagesOfAnySize) {
  for (const auto& [width, height] : {std::pair(0, 0), {1, 1}, {64, 3}, {65, 1}, {3, 200}}) {
    BitImage full(width, height);
    for (int r = 0; r < height; ++r) {
      for (int c = 0; c < width; ++c) full.set(r, c);
    }
    EXPECT_EQ(dilated(full), full);
    EXPECT_EQ(euler_number(full), width > 0 ? 1 : 0);
    EXPECT_EQ(euler_number(thinned(full)), width > 0 ? 1 : 0);
    EXPECT_EQ(BitImage::from(full.mask()), full);
  }
}

}  // namespace
}  // namespace fringeslam
