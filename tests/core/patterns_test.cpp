// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <algorithm>
#include <bit>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "core/patterns/design.h"
#include "core/patterns/long_run_code.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

// Returns the levels along a pattern's axis for a projector of the given length.
std::vector<float> profile(const Pattern& pattern, int length) {
  const cv::Mat1f levels = pattern_levels(pattern, {length, length, {}});
  return {levels.begin(), levels.end()};
}

std::vector<double> shifts_of(const PatternSequence& sequence) {
  std::vector<double> shifts;
  for (const Pattern& pattern : sequence.patterns) shifts.push_back(pattern.shift_rad);
  return shifts;
}

TEST(Patterns, TheFinestAreThoseOfTheLeastPeriodInTheirOrder) {
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  const PatternSequence finest = finest_patterns(sequence, Axis::columns);
  ASSERT_EQ(finest.patterns.size(), 3u);
  for (size_t i = 0; i < 3; ++i) EXPECT_EQ(finest.patterns[i], sequence.patterns[6 + i]);
  EXPECT_EQ(finest.width, sequence.width);
  EXPECT_TRUE(finest_patterns(sequence, Axis::rows).patterns.empty());
}

TEST(Patterns, AbsolutePhaseStartsAtTheImageBorder) {
  EXPECT_EQ(absolute_phase(-0.5, 16), 0);
  EXPECT_NEAR(absolute_phase(15.5, 16), 2 * kPi, 1e-15);
  EXPECT_NEAR(absolute_phase(1023.5, 16), 64 * 2 * kPi, 1e-12);
}

TEST(Patterns, AbsolutePhaseRoundTrip) {
  for (const double period : {5.0, 16.5, 1040.0}) {
    for (double u = -0.5; u < 1024; u += 7.3)
      EXPECT_NEAR(projector_coordinate(absolute_phase(u, period), period), u, 1e-12);
  }
}

TEST(Patterns, ThreeStepsAreThePapers) {
  const auto sequence = phase_shift_sequence(1024, 768, {32}, 3, Axis::columns, 8);
  EXPECT_THAT(shifts_of(sequence),
              ElementsAre(DoubleNear(-2 * kPi / 3, 1e-15), DoubleNear(0, 1e-15), DoubleNear(2 * kPi / 3, 1e-15)));
}

TEST(Patterns, StepsAreEquallySpacedAndCentred) {
  for (const int steps : {3, 4, 5, 7, 12}) {
    const auto shifts = shifts_of(phase_shift_sequence(1024, 768, {32}, steps, Axis::rows, 8));
    ASSERT_EQ(shifts.size(), static_cast<size_t>(steps));
    EXPECT_NEAR(std::accumulate(shifts.begin(), shifts.end(), 0.0), 0, 1e-13);
    for (size_t k = 1; k < shifts.size(); ++k) EXPECT_NEAR(shifts[k] - shifts[k - 1], 2 * kPi / steps, 1e-14);
  }
}

TEST(Patterns, SequenceIsPeriodAfterPeriod) {
  const auto sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 4, Axis::rows, 6);
  ASSERT_EQ(sequence.patterns.size(), 12U);
  EXPECT_EQ(sequence.width, 1024);
  EXPECT_EQ(sequence.height, 768);
  for (size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(sequence.patterns[i].period_px, (std::vector<double>{1040, 131, 16.5}[i / 4]));
    EXPECT_EQ(sequence.patterns[i].axis, Axis::rows);
    EXPECT_EQ(sequence.patterns[i].bits, 6);
  }
}

TEST(Patterns, ContinuousProfileIsTheSinusoid) {
  // With a period of 4, the phases at the pixel centres are 45, 135, 225 and 315 degrees.
  const float high = static_cast<float>(0.5 + 0.5 * std::sqrt(0.5)), low = 1 - high;
  const auto near = [](float x) { return testing::FloatNear(x, 1e-7F); };
  EXPECT_THAT(profile({Axis::columns, 4, 0, 0}, 5),
              ElementsAre(near(high), near(low), near(low), near(high), near(high)));
  EXPECT_THAT(profile({Axis::columns, 4, kPi / 2, 0}, 4), ElementsAre(near(low), near(low), near(high), near(high)));
  EXPECT_NEAR(ideal_intensity({Axis::columns, 64, kPi / 2, 0}, 15.5), 0, 1e-15);  // phase pi/2 + shift pi/2
}

TEST(Patterns, QuantisedProfileHasTheLevelsOfItsBits) {
  EXPECT_THAT(profile({Axis::columns, 4, 0, 1}, 4), ElementsAre(1, 0, 0, 1));
  for (const int bits : {1, 2, 4, 8, 10}) {
    const double levels = (1 << bits) - 1;
    const auto exact = profile({Axis::columns, 37, 0.4, 0}, 500);
    const auto quantised = profile({Axis::columns, 37, 0.4, bits}, 500);
    for (size_t i = 0; i < exact.size(); ++i) {
      EXPECT_NEAR(quantised[i], exact[i], 0.5 / levels + 1e-6);
      EXPECT_NEAR(quantised[i] * levels, std::round(quantised[i] * levels), 1e-3);
    }
  }
}

TEST(Patterns, ImageVariesAlongItsAxisOnly) {
  const cv::Mat1b columns = pattern_image({Axis::columns, 4, 0, 1}, {8, 6, {}});
  const cv::Mat1b rows = pattern_image({Axis::rows, 4, 0, 1}, {6, 8, {}});
  ASSERT_EQ(columns.size(), cv::Size(8, 6));
  for (int i = 0; i < 8; ++i) {
    const uchar expected = i % 4 == 0 || i % 4 == 3 ? 255 : 0;
    for (int j = 0; j < 6; ++j) {
      EXPECT_EQ(columns(j, i), expected);
      EXPECT_EQ(rows(i, j), expected);
    }
  }
}

// A product of cosines is half the sum of the cosines of the sum and of the difference of the phases.
TEST(Patterns, ProductIsTheSumOfTwoCosines) {
  Pattern product{Axis::columns, 64, 0.3, 0, Coding::product};
  product.carrier_px = 16;
  product.carrier_shift_rad = -0.8;
  for (double u = -0.5; u < 200; u += 3.7) {
    const double sum = 2 * kPi * (u + 0.5) * (1.0 / 16 + 1.0 / 64) + 0.3 - 0.8,
                 difference = 2 * kPi * (u + 0.5) * (1.0 / 16 - 1.0 / 64) - 0.8 - 0.3;
    EXPECT_NEAR(ideal_intensity(product, u), 0.5 + 0.25 * (std::cos(sum) + std::cos(difference)), 1e-13);
  }
}

TEST(Patterns, ExtraImageIsAFringe) {
  Pattern extra{Axis::rows, 21.1, 0.3, 8, Coding::extra};
  Pattern fringe = extra;
  fringe.coding = Coding::fringe;
  EXPECT_EQ(profile(extra, 300), profile(fringe, 300));
}

TEST(Patterns, WithoutADecoderBelongToNoGroup) {
  PatternSequence sequence = phase_shift_sequence(1024, 768, {64}, 3, Axis::columns, 8);
  for (const double shift : {0.0, 2.0, 4.0}) {
    sequence.patterns.push_back({Axis::columns, 64, shift + 0.1, 8, Coding::extra});
    sequence.patterns.push_back({Axis::columns, 64, shift + 0.1, 8, Coding::product});
    sequence.patterns.push_back({Axis::rows, 64, shift + 0.1, 8, Coding::extra});
  }
  EXPECT_THAT(fringe_groups(sequence, Axis::columns).at(0).images, ElementsAre(0, 1, 2));
  EXPECT_EQ(finest_patterns(sequence, Axis::columns).patterns.size(), 3U);
  EXPECT_TRUE(fringe_groups(sequence, Axis::rows).empty());
  EXPECT_TRUE(codes_axis(sequence, Axis::columns));
  EXPECT_FALSE(codes_axis(sequence, Axis::rows));
  EXPECT_NO_THROW(require_decoder(sequence, Axis::columns));
  EXPECT_THAT(error_of([&] { require_decoder(sequence, Axis::rows); }),
              HasSubstr("rows are coded only by `extra` images, which determine no phase by themselves; add "
                        "`fringe` images"));
}

Pattern gray(double cell_px, bool inverted = false) {
  Pattern pattern{Axis::columns, cell_px, 0, 1, Coding::gray};
  pattern.inverted = inverted;
  return pattern;
}

TEST(GrayCode, BitOfACellWidthIsTheReflectedCodesBit) {
  for (int u = 0; u < 256; ++u) {
    for (int bit = 0; bit < 5; ++bit) {
      const int cell = u / 8, code = cell ^ (cell >> 1);
      EXPECT_EQ(ideal_intensity(gray(8 << bit), u), (code >> bit) & 1) << u << ", bit " << bit;
      EXPECT_EQ(ideal_intensity(gray(8 << bit, true), u), 1 - ((code >> bit) & 1));
    }
  }
}

TEST(GrayCode, PatternsTellAllCellsApartAndNeighboursDifferInOneBit) {
  for (const double cell : {16.5, 30.0, 7.3}) {
    const auto patterns = gray_patterns(Axis::columns, cell, 1024, 1);
    std::map<std::vector<double>, int> cells;
    std::vector<double> last;
    for (int u = 0; u < 1024; ++u) {
      std::vector<double> code;
      for (const Pattern& pattern : patterns) code.push_back(ideal_intensity(pattern, u));
      const auto [entry, fresh] = cells.insert({code, gray_cell(u, cell)});
      EXPECT_EQ(entry->second, gray_cell(u, cell)) << "one code for two cells";
      int changes = 0;
      for (size_t i = 0; i < last.size(); ++i) changes += last[i] != code[i];
      EXPECT_EQ(changes, fresh && u > 0 ? 1 : 0);
      last = code;
    }
    EXPECT_EQ(cells.size(), static_cast<size_t>(gray_cell(1023, cell) + 1));
  }
}

TEST(GrayCode, ExclusiveOrKeepsStripesNarrowAndTheCode) {
  constexpr int kLength = 1024;
  const std::vector<Pattern> plain = gray_patterns(Axis::columns, 4, kLength, 1),
                             combined = gray_patterns(Axis::columns, 4, kLength, 1, 8);
  ASSERT_EQ(plain.size(), combined.size());
  const size_t carrier = plain.size() - 2;
  for (size_t i = 0; i < plain.size(); ++i) {
    int widest = 0, run = 0;
    for (int u = 0; u < kLength; ++u) {
      const double shown = ideal_intensity(combined[i], u);
      const bool base = i < carrier && ideal_intensity(combined[carrier], u) > 0.5;
      EXPECT_EQ(base ? 1 - shown : shown, ideal_intensity(plain[i], u));
      run = u > 0 && ideal_intensity(combined[i], u - 1) == shown ? run + 1 : 1;
      widest = std::max(widest, run);
    }
    EXPECT_LE(widest, 16) << i;
  }
  EXPECT_THAT(error_of([] { gray_patterns(Axis::columns, 4, 1024, 1, 6); }), HasSubstr("no bit with cells of 6 px"));
}

TEST(GrayCode, BitsAreFoundCoarsestFirstWithTheirInverses) {
  const PatternSequence sequence{64, 64, {gray(8), gray(16, true), gray(16), {Axis::columns, 8, 0, 8}, gray(32)}};
  const auto bits = gray_bits(sequence, Axis::columns);
  ASSERT_EQ(bits.size(), 3U);
  EXPECT_EQ(bits[0].cell_px, 32);
  EXPECT_EQ(bits[0].image, 4);
  EXPECT_EQ(bits[0].inverted_image, -1);
  EXPECT_EQ(bits[1].image, 2);
  EXPECT_EQ(bits[1].inverted_image, 1);
  EXPECT_TRUE(gray_bits(sequence, Axis::rows).empty());
  EXPECT_EQ(fringe_groups({64, 64, {gray(8), gray(16)}}, Axis::columns).size(), 0U) << "Gray bits are no fringes";
}

TEST(Design, SequenceHasWhatWasAskedFor) {
  SequenceDesign design{1024, 768, true, true, {1040, 64}, 4, GrayCode::complementary, true, true};
  const PatternSequence sequence = design_sequence(design);
  // 64 px periods: 16 columns and 12 rows need 4 bits each, plus one complementary bit; each bit is also inverted.
  EXPECT_EQ(sequence.patterns.size(), 2 * (2 * 4 + 2 * 5) + 2U);
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    EXPECT_EQ(fringe_groups(sequence, axis).size(), 2U);
    ASSERT_EQ(gray_bits(sequence, axis).size(), 5U);
    EXPECT_EQ(gray_bits(sequence, axis).back().cell_px, 32);
    EXPECT_GE(gray_bits(sequence, axis).back().inverted_image, 0);
  }
  EXPECT_EQ(sequence.patterns.end()[-2].level, 1);
  EXPECT_EQ(sequence.patterns.back().level, 0);
}

TEST(Design, ExtraPeriodsAndProductsFollowTheGrayCode) {
  SequenceDesign design{64, 48, true, true, {16}, 3, GrayCode::plain};
  design.extra_periods_px = {21.1, 20.3};
  design.product_periods_px = {32};
  design.carrier_px = 8;
  const std::vector<Pattern> patterns = design_sequence(design).patterns;
  // Per axis 3 fringes, 2 bits, 2 extra images, 3 x 3 products.
  ASSERT_EQ(patterns.size(), 2 * (3 + 2 + 2 + 9U));
  EXPECT_EQ(patterns[5], (Pattern{Axis::columns, 21.1, 0, 8, Coding::extra}));
  EXPECT_EQ(patterns[16 + 6], (Pattern{Axis::rows, 20.3, 0, 8, Coding::extra}));
  for (int k = 0; k < 9; ++k) {
    const Pattern& product = patterns[static_cast<size_t>(7 + k)];
    EXPECT_EQ(product.coding, Coding::product);
    EXPECT_EQ(product.period_px, 32);
    EXPECT_EQ(product.carrier_px, 8);
    EXPECT_NEAR(product.shift_rad, 2 * kPi / 3 * (k / 3 - 1), 1e-14);
    EXPECT_NEAR(product.carrier_shift_rad, 2 * kPi / 3 * (k % 3 - 1), 1e-14);
  }
  design.carrier_px = 0;
  EXPECT_THAT(error_of([&] { design_sequence(design); }), HasSubstr("add carrier_px"));
  design.product_periods_px.clear();
  design.carrier_px = 8;
  EXPECT_THAT(error_of([&] { design_sequence(design); }), HasSubstr("add product_periods_px"));
}

TEST(LongRunCode, ChangesOneBitAtATimeAndKeepsEachForSeveralCells) {
  constexpr int kShortest[] = {2, 2, 2, 2, 4, 3, 5, 5, 6, 7, 8, 8},
                kLongest[] = {2, 4, 8, 16, 8, 11, 11, 13, 15, 18, 20, 20};
  for (int bits = 2; bits <= 12; ++bits) {
    const std::vector<unsigned>& words = long_run_code(bits);
    const size_t cells = words.size();
    ASSERT_EQ(cells, size_t{1} << bits);
    EXPECT_EQ(std::set<unsigned>(words.begin(), words.end()).size(), cells);
    for (size_t i = 0; i < cells; ++i) EXPECT_EQ(std::popcount(words[i] ^ words[(i + 1) % cells]), 1);
    int shortest = 1 << bits, longest = 0;
    for (int bit = 0; bit < bits; ++bit) {
      std::vector<int> changes;
      for (size_t i = 0; i < 2 * cells; ++i) {
        if ((words[i % cells] ^ words[(i + 1) % cells]) >> bit & 1U) changes.push_back(static_cast<int>(i));
      }
      for (size_t i = 1; i < changes.size(); ++i) {
        shortest = std::min(shortest, changes[i] - changes[i - 1]);
        longest = std::max(longest, changes[i] - changes[i - 1]);
      }
    }
    EXPECT_GE(shortest, kShortest[bits - 1]) << bits;
    EXPECT_LE(longest, kLongest[bits - 1]) << bits;
  }
  EXPECT_THAT(error_of([] { long_run_code(15); }), HasSubstr("1 to 14 bits, not 15"));
}

TEST(Design, SeveralGrayCodesShareTheBitsOfTheirCarriers) {
  SequenceDesign design{1024, 768, true, false, {16}, 3, GrayCode::complementary};
  design.gray_xor_px = {0, 16, 32};
  design.gray_long_runs = true;
  const PatternSequence sequence = design_sequence(design);
  // Cells of 8 px: 7 bits of the plain code, 6 and 5 combined with the carriers, 7 with long runs.
  EXPECT_EQ(sequence.patterns.size(), 3 + 7 + 6 + 5 + 7U);
  const auto codes = gray_codes(sequence, Axis::columns);
  ASSERT_EQ(codes.size(), 4U);
  for (const auto& bits : codes) EXPECT_EQ(bits.size(), 7U);
  EXPECT_EQ(codes[1].front().carrier_px, 8);
  EXPECT_EQ(codes[2].front().carrier_px, 16);
  EXPECT_EQ(codes[3].front().code_bits, 7);
}

TEST(Design, EmptyOrUnnumberedIsAnError) {
  EXPECT_THAT(error_of([] { design_sequence({1024, 768}); }), HasSubstr("the sequence is empty"));
  EXPECT_THAT(error_of([] {
                design_sequence({1024, 768, true, false, {}, 3, GrayCode::plain});
              }),
              HasSubstr("a Gray code numbers fringe periods"));
}

TEST(Dithering, KeepsTheMeanAndUsesOnlyItsLevels) {
  Pattern pattern{Axis::columns, 64, 0.3, 1};
  pattern.dithered = true;
  const cv::Mat1f shown = pattern_levels(pattern, {256, 128, {}});
  ASSERT_EQ(shown.size(), cv::Size(256, 128));
  for (const float level : shown) EXPECT_TRUE(level == 0 || level == 1);
  // Averaged over a few pixels, as by defocus, the pattern is the sinusoid.
  double worst = 0;
  for (int col = 8; col < 248; ++col) {
    double sum = 0, ideal = 0;
    for (int c = col - 4; c < col + 4; ++c) {
      ideal += ideal_intensity(pattern, c) / 8;
      for (int row = 0; row < 128; ++row) sum += static_cast<double>(shown(row, c)) / (8 * 128);
    }
    worst = std::max(worst, std::abs(sum - ideal));
  }
  EXPECT_LT(worst, 0.01);
}

TEST(Packing, ChannelsAreTheImagesInTheOrderGiven) {
  std::vector<cv::Mat1b> images;
  for (int i = 0; i < 3; ++i) images.emplace_back(2, 3, static_cast<uchar>(10 * (i + 1)));
  EXPECT_EQ(packed_image(images, "RGB")(0, 0), cv::Vec3b(30, 20, 10));  // OpenCV stores blue, green, red
  EXPECT_EQ(packed_image(images, "GBR")(1, 2), cv::Vec3b(20, 10, 30));
  EXPECT_THAT(error_of([&] { packed_image(images, "RRB"); }), HasSubstr("must name each of R, G and B once"));
}

TEST(InverseResponse, PatternThroughTheProjectorIsTheSinusoid) {
  std::vector<double> gamma;
  for (int i = 0; i <= 512; ++i) gamma.push_back(std::pow(i / 512.0, 2.2));
  PatternSequence sequence{64, 64, {}, invert_table(gamma, 1025)};
  for (double level = 0; level <= 1; level += 0.01)
    EXPECT_NEAR(interpolate_table(gamma, interpolate_table(sequence.inverse_response, level)), level, 2e-3);
  const Pattern pattern{Axis::columns, 32, 0.2, 0};
  const cv::Mat1f shown = pattern_levels(pattern, sequence);
  for (int u = 0; u < 64; ++u)
    EXPECT_NEAR(std::pow(static_cast<double>(shown(u)), 2.2), ideal_intensity(pattern, u), 3e-3);
}

TEST(FringeGroups, SortCoarsestFirstAndKeepToTheirAxis) {
  const PatternSequence shuffled = {1024,
                                    768,
                                    {{Axis::columns, 16, 0, 8},
                                     {Axis::columns, 128, 1, 8},
                                     {Axis::rows, 64, 0, 8},
                                     {Axis::columns, 16, 2, 8},
                                     {Axis::columns, 128, 3, 8},
                                     {Axis::columns, 128, 5, 8},
                                     {Axis::rows, 64, 1, 8},
                                     {Axis::columns, 16, 4, 8},
                                     {Axis::rows, 64, 2, 8}}};
  const auto groups = fringe_groups(shuffled, Axis::columns);
  ASSERT_EQ(groups.size(), 2U);
  EXPECT_EQ(groups[0].period_px, 128);
  EXPECT_THAT(groups[0].images, ElementsAre(1, 4, 5));
  EXPECT_THAT(groups[0].shifts_rad, ElementsAre(1, 3, 5));
  EXPECT_EQ(groups[1].period_px, 16);
  EXPECT_THAT(groups[1].images, ElementsAre(0, 3, 7));
  EXPECT_THAT(fringe_groups(shuffled, Axis::rows).at(0).images, ElementsAre(2, 6, 8));
}

TEST(FringeGroups, FewerThanThreeShiftsIsAnError) {
  const auto with_shifts = [](const std::vector<double>& shifts) {
    PatternSequence sequence{1024, 768, {}};
    for (const double shift : shifts) sequence.patterns.push_back({Axis::columns, 1024, shift, 8});
    return error_of([&] { fringe_groups(sequence, Axis::columns); });
  };
  EXPECT_THAT(with_shifts({0, 1}), HasSubstr("period 1024 px has fewer than three distinct phase shifts"));
  EXPECT_THAT(with_shifts({0, 1, 1}), HasSubstr("fewer than three distinct phase shifts"));
  // A shift by a whole turn gives the same image: two equations for three unknowns.
  EXPECT_THAT(with_shifts({0, kPi, 2 * kPi}), HasSubstr("fewer than three distinct phase shifts"));
}

}  // namespace
}  // namespace fringeslam
