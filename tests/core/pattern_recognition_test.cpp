// SPDX-License-Identifier: Apache-2.0
// Patterns recognized from images of what a projector shows.
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "core/patterns/design.h"
#include "core/patterns/recognition.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::Random;
using testing::HasSubstr;
using testing::Not;

constexpr double kPi = std::numbers::pi;
const cv::Size kProjector(1024, 768);

int length_along(Axis axis) { return axis == Axis::columns ? kProjector.width : kProjector.height; }

// Image whose levels are a function of the projector coordinate, rounded to 8 bits.
template <class Level>
cv::Mat1b image_of(Axis axis, Level&& level) {
  cv::Mat1b line(axis == Axis::columns ? cv::Size(kProjector.width, 1) : cv::Size(1, kProjector.height));
  for (int i = 0; i < length_along(axis); ++i) line(i) = cv::saturate_cast<uchar>(255 * level(i));
  return cv::repeat(line, kProjector.height / line.rows, kProjector.width / line.cols);
}

cv::Mat1b image_of(const Pattern& pattern, double dark = 0, double bright = 1) {
  return image_of(pattern.axis, [&](int i) { return dark + (bright - dark) * ideal_intensity(pattern, i); });
}

double angle_between(double a, double b) { return std::abs(std::remainder(a - b, 2 * kPi)); }

std::vector<RecognizedPattern> recognized(const std::vector<Pattern>& patterns, double dark = 0, double bright = 1) {
  std::vector<RecognizedPattern> all;
  for (const Pattern& pattern : patterns) all.push_back(recognize_pattern(image_of(pattern, dark, bright), kProjector));
  return all;
}

// --- cosines ---

// Standard deviation of a fitted frequency, cycles/px, for independent errors of the levels: the Cramer-Rao bound of a
// cosine with unknown phase and modulation, 6 sigma^2 / (pi^2 A^2 n^3).
double frequency_sigma(double modulation_dn, int length) {
  const double sigma_dn = std::sqrt(1.0 / 12);
  return std::sqrt(6 / std::pow(length, 3)) * sigma_dn / (kPi * modulation_dn);
}

TEST(RecognizedCosines, HaveTheirPeriodShiftAndModulation) {
  constexpr double kSigmas = 7;  // of the fit, and three for a simpler value
  for (uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    const Axis axis = seed % 2 ? Axis::rows : Axis::columns;
    const int length = length_along(axis);
    const double period_px = std::exp(random.uniform(std::log(5.0), std::log(0.3 * length)));
    const Pattern shown{axis, period_px, random.uniform(-kPi, kPi)};
    const double dark = random.uniform(0, 0.3), bright = random.uniform(0.6, 1);
    const RecognizedPattern found = recognize_pattern(image_of(shown, dark, bright), kProjector);
    ASSERT_EQ(found.pattern.coding, Coding::fringe) << seed;
    EXPECT_EQ(found.pattern.axis, axis);
    const double off = std::abs(found.pattern.period_px / period_px - 1);
    EXPECT_LT(off, 1e-4) << "seed " << seed << ", period " << period_px;
    EXPECT_LT(off, kSigmas * frequency_sigma(127.5 * (bright - dark), length) * period_px) << "seed " << seed;
    EXPECT_LT(angle_between(found.pattern.shift_rad, shown.shift_rad), 0.01) << "seed " << seed;
    EXPECT_NEAR(found.dark, dark, 1e-3);
    EXPECT_NEAR(found.bright, bright, 1e-3);
  }
}

TEST(RecognizedCosines, LongerThanTheImageAreRecognized) {
  for (const double factor : {0.6, 1.0, 1.4, 2.0}) {
    const double period_px = factor * 1031.7;
    for (const double shift_rad : {-2.0, -0.3, 0.5, 1.9}) {
      const Pattern found = recognize_pattern(image_of({Axis::columns, period_px, shift_rad}), kProjector).pattern;
      ASSERT_EQ(found.coding, Coding::fringe);
      EXPECT_NEAR(found.period_px, period_px, 2e-3 * period_px);
      // The phase in the middle of the image.
      const auto middle = [](const Pattern& p) { return absolute_phase(511.5, p.period_px) + p.shift_rad; };
      EXPECT_LT(angle_between(middle(found), middle({Axis::columns, period_px, shift_rad})), 0.01);
    }
  }
}

TEST(RecognizedCosines, SimpleParametersAreExact) {
  const double third = 2 * kPi / 3;
  for (const double period_px : {1040.0, 131.0, 16.5, 21.489, 1024.0 / 15, 60.0}) {
    for (const double shift_rad : {-third, 0.0, third, -kPi / period_px, third - kPi / period_px}) {
      const Pattern found =
          recognize_pattern(image_of({Axis::columns, period_px, shift_rad}, 10 / 255.0, 245 / 255.0), kProjector)
              .pattern;
      EXPECT_EQ(found.period_px, period_px);
      EXPECT_LT(angle_between(found.shift_rad, shift_rad), 1e-12) << period_px << ", " << shift_rad;
    }
  }
}

TEST(RecognizedCosines, OtherDepthsOfTheFileAreTheSame) {
  const Pattern shown{Axis::rows, 37.35, 0.7, 0};
  cv::Mat1f exact(kProjector);
  cv::repeat(pattern_levels(shown, {kProjector.width, kProjector.height, {}}), 1, kProjector.width).copyTo(exact);
  cv::Mat wide;
  exact.convertTo(wide, CV_16U, 65535);
  cv::Mat twelve_bits;  // in a 16-bit file
  exact.convertTo(twelve_bits, CV_16U, 4095);
  for (const cv::Mat& image : {cv::Mat(exact), wide, twelve_bits}) {
    const Pattern found = recognize_pattern(image, kProjector).pattern;
    EXPECT_EQ(found.axis, Axis::rows);
    EXPECT_EQ(found.period_px, 37.35);
    EXPECT_NEAR(found.shift_rad, 0.7, 2e-4);
  }
}

// --- Gray codes and flat images ---

TEST(RecognizedGrayBits, AreTheReflectedCodesBits) {
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (const double cell_px : {1.0, 8.25, 16.5, 30.0, 1024.0 / 15}) {
      for (const bool inverted : {false, true}) {
        for (Pattern shown : gray_patterns(axis, cell_px, length_along(axis), 8)) {
          shown.inverted = inverted;
          const Pattern found = recognize_pattern(image_of(shown, 0.04, 0.96), kProjector).pattern;
          ASSERT_EQ(found.coding, Coding::gray);
          EXPECT_EQ(found.axis, axis);
          EXPECT_EQ(found.inverted, inverted);
          for (int i = 0; i < length_along(axis); ++i) ASSERT_EQ(ideal_intensity(found, i), ideal_intensity(shown, i));
        }
      }
    }
  }
}

TEST(RecognizedGrayBits, MayBeCombinedByXor) {
  for (const double cell_px : {1.0, 8.25, 30.0}) {
    for (const double carrier : {1, 2, 4}) {
      const std::vector<Pattern> shown = gray_patterns(Axis::columns, cell_px, kProjector.width, 8, carrier * cell_px);
      std::vector<RecognizedPattern> found = recognized(shown);
      reconcile_patterns(found, {}, kProjector);
      for (size_t i = 0; i < shown.size(); ++i) {
        EXPECT_EQ(found[i].pattern.period_px, shown[i].period_px) << cell_px << ", bit " << i;
        EXPECT_EQ(found[i].pattern.carrier_px, shown[i].carrier_px) << cell_px << ", bit " << i;
      }
    }
  }
}

TEST(RecognizedGrayBits, OfASequenceHalveTheirCells) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    Random random(seed);
    const double cell_px = random.uniform(1.5, 40);
    std::vector<RecognizedPattern> bits = recognized(gray_patterns(Axis::columns, cell_px, kProjector.width, 8));
    reconcile_patterns(bits, {}, kProjector);
    for (size_t i = 1; i < bits.size(); ++i)
      EXPECT_EQ(bits[i - 1].pattern.period_px, 2 * bits[i].pattern.period_px) << "seed " << seed;
    EXPECT_NEAR(bits.back().pattern.period_px, cell_px, cell_px * cell_px / kProjector.width);
  }
}

TEST(RecognizedGrayBits, NumberThePeriodsOfTheFringes) {
  const double period_px = 21.489;
  std::vector<Pattern> shown = phase_shift_sequence(1024, 768, {period_px}, 3, Axis::columns, 8).patterns;
  for (const Pattern& bit : gray_patterns(Axis::columns, period_px / 2, 1024, 8)) shown.push_back(bit);
  std::vector<RecognizedPattern> found = recognized(shown);
  reconcile_patterns(found, {}, kProjector);
  for (size_t i = 0; i < shown.size(); ++i) EXPECT_EQ(found[i].pattern.period_px, shown[i].period_px) << i;
}

TEST(RecognizedLevels, AreSharesOfTheSequencesRange) {
  const auto flat = [](double level) { return Pattern{.coding = Coding::flat, .level = level}; };
  const std::vector<Pattern> shown = {{Axis::columns, 64, 0}, flat(1), flat(0), flat(0.5)};
  std::vector<RecognizedPattern> found = recognized(shown, 10 / 255.0, 245 / 255.0);
  EXPECT_NEAR(found[1].pattern.level, 245 / 255.0, 1e-9);
  reconcile_patterns(found, {}, kProjector);
  EXPECT_EQ(found[1].pattern.level, 1);
  EXPECT_EQ(found[2].pattern.level, 0);
  EXPECT_NEAR(found[3].pattern.level, 0.5, 0.003);
  // The range of a ramp is unknown.
  std::vector<RecognizedPattern> ramp = recognized({flat(0.2), flat(0.6)});
  reconcile_patterns(ramp, {}, kProjector);
  EXPECT_NEAR(ramp[0].pattern.level, 0.2, 1e-12);
  EXPECT_NEAR(ramp[1].pattern.level, 0.6, 1e-12);
}

// --- sequences ---

TEST(ReconciledPatterns, FringesOfAPeriodFormAGroupAndOthersAreExtra) {
  const double a = 37.123456, b = 21.3987654;
  std::vector<Pattern> shown = phase_shift_sequence(1024, 768, {a}, 7, Axis::columns, 8).patterns;
  shown.push_back({Axis::columns, b, 0.3});
  shown.push_back({Axis::columns, b, 1.3});
  shown.push_back({Axis::rows, a, 0.3});
  std::vector<RecognizedPattern> found = recognized(shown);
  reconcile_patterns(found, {}, kProjector);
  PatternSequence sequence{1024, 768, {}};
  for (const RecognizedPattern& each : found) sequence.patterns.push_back(each.pattern);
  const std::vector<FringeGroup> groups = fringe_groups(sequence, Axis::columns);
  ASSERT_EQ(groups.size(), 1U);
  EXPECT_EQ(groups[0].images.size(), 7U);
  EXPECT_NEAR(groups[0].period_px, a, 1e-4 * a);
  EXPECT_TRUE(fringe_groups(sequence, Axis::rows).empty());
  for (size_t i = 7; i < 10; ++i) EXPECT_EQ(sequence.patterns[i].coding, Coding::extra);
  // A described pattern with the same period gives it.
  found = recognized(shown);
  reconcile_patterns(found, {{Axis::columns, 1.0005 * b, 2.3}}, kProjector);
  EXPECT_EQ(found[7].pattern.coding, Coding::fringe);
  EXPECT_EQ(found[7].pattern.period_px, 1.0005 * b);
}

TEST(ReconciledPatterns, AreThoseOfADesignedSequence) {
  SequenceDesign design{1024, 768, true, true, {1040, 131, 16.5}, 3, GrayCode::complementary, true, true};
  design.extra_periods_px = {21.1, 20.3};
  const PatternSequence designed = design_sequence(design);
  std::vector<RecognizedPattern> found = recognized(designed.patterns);
  reconcile_patterns(found, {}, kProjector);
  for (size_t i = 0; i < found.size(); ++i) {
    Pattern same = found[i].pattern;
    EXPECT_LT(angle_between(same.shift_rad, designed.patterns[i].shift_rad), 1e-12) << i;
    same.shift_rad = designed.patterns[i].shift_rad;
    EXPECT_TRUE(same == designed.patterns[i]) << i;
  }
}

TEST(ReconciledPatterns, EqualStepsAreExactlyEqual) {
  for (const int steps : {3, 4, 7, 8, 16}) {
    for (const double period_px : {8.0, 16.5, 37.123456}) {
      std::vector<Pattern> shown = phase_shift_sequence(1024, 768, {period_px}, steps, Axis::columns, 8).patterns;
      // The papers' centred steps; steps from 0 in the middle of the first pixel; steps from an arbitrary shift.
      for (const double offset_rad : {0.0, kPi * (steps - 1) / steps - kPi / period_px, 0.1234}) {
        std::vector<Pattern> shifted = shown;
        for (Pattern& pattern : shifted) pattern.shift_rad += offset_rad;
        std::vector<RecognizedPattern> found = recognized(shifted);
        reconcile_patterns(found, {}, kProjector);
        for (size_t k = 0; k < shown.size(); ++k) {
          const double off_rad = angle_between(found[k].pattern.shift_rad, shifted[k].shift_rad);
          EXPECT_LT(off_rad, offset_rad == 0.1234 ? 5e-3 : 1e-6) << steps << " steps of " << period_px;
          const double step_rad = found[k].pattern.shift_rad - found[0].pattern.shift_rad;
          EXPECT_LT(angle_between(step_rad, 2 * kPi * static_cast<double>(k) / steps), 1e-9);
        }
      }
    }
  }
}

// --- refused images ---

std::string refused(const cv::Mat& image) {
  return error_of([&] { recognize_pattern(image, kProjector); });
}

double number_after(const std::string& message, const std::string& words) {
  const size_t at = message.find(words);
  return at == std::string::npos ? std::nan("") : std::atof(message.c_str() + at + words.size());
}

TEST(RefusedPatterns, SayBothSizes) {
  EXPECT_THAT(error_of([] { recognize_pattern(cv::Mat1b(8, 1280, uchar{0}), kProjector); }),
              HasSubstr("is 1280x8 px but the projector has 1024x768 px; list the images"));
}

TEST(RefusedPatterns, OfACosineThroughAGammaNameIt) {
  for (const double gamma : {0.45, 0.7, 1.3, 2.2}) {
    for (const double period_px : {21.489, 60.0, 341.3}) {
      const Pattern pattern{Axis::columns, period_px, 0.4 - kPi / period_px};
      const std::string message =
          refused(image_of(pattern.axis, [&](int i) { return std::pow(ideal_intensity(pattern, i), gamma); }));
      EXPECT_THAT(message, testing::StartsWith("is not a cosine (the best one leaves "));
      EXPECT_THAT(message, HasSubstr("but a monotone function of one along columns, of period"));
      EXPECT_NEAR(number_after(message, "period "), period_px, 1e-3 * period_px);
      EXPECT_NEAR(number_after(message, "phase_offset_deg "), 0.4 * 180 / kPi, 0.2);
      EXPECT_NEAR(number_after(message, "gamma of "), gamma, 0.03 * gamma);
      EXPECT_THAT(message, HasSubstr("instead of `projected`, and state the pre-distortion"));
    }
  }
}

TEST(RefusedPatterns, OfAnyMonotoneFunctionSaySo) {
  const Pattern pattern{Axis::rows, 48, 0.2};
  const std::string message = refused(image_of(pattern.axis, [&](int i) {
    const double level = ideal_intensity(pattern, i);
    return level * level * (3 - 2 * level);
  }));
  EXPECT_THAT(message, HasSubstr("but a monotone function of one along rows, of period 48 px"));
  EXPECT_THAT(message, Not(HasSubstr("gamma")));
}

TEST(RefusedPatterns, ProductsNameTheBestCosine) {
  Pattern product{Axis::columns, 131, 0.3, 8, Coding::product};
  product.carrier_px = 16.5;
  const std::string message = refused(image_of(product));
  EXPECT_THAT(message, HasSubstr("is neither flat nor a Gray code bit nor a cosine; the best cosine, along columns, of "
                                 "period "));
  EXPECT_THAT(message, HasSubstr(" % of the range (rms); describe it by `fringe`, `extra`, `product`"));
}

TEST(RefusedPatterns, VaryAlongBothAxesOrHardly) {
  cv::Mat1b both(kProjector);
  for (int row = 0; row < both.rows; ++row) {
    for (int col = 0; col < both.cols; ++col) both(row, col) = static_cast<uchar>((row + col) % 256);
  }
  EXPECT_THAT(refused(both), HasSubstr("varies along columns and along rows"));
  EXPECT_THAT(refused(image_of({Axis::columns, 64, 0}, 0.5, 0.515)), HasSubstr("varies by only 1."));
}

TEST(RefusedPatterns, BinaryCodesAreNoGrayCodes) {
  EXPECT_THAT(
      refused(image_of(Axis::columns, [](int i) { return i / 128 % 2; })),
      HasSubstr("has two levels with edges at 128, 256, 384, 512, ... px, but is no bit of a reflected Gray code"));
}

}  // namespace
}  // namespace fringeslam
