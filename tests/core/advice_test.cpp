// SPDX-License-Identifier: Apache-2.0
// Advice from synthetic stacks of known brightness: exposures in closed form, brightness behind saturation, codings.
#include "core/decode/advice.h"

#include <gmock/gmock.h>

#include <cmath>

#include "tests/support/fringes.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::Random;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kRows = 64, kCols = 96;
constexpr double kModulation = 0.8;  // I'' / I' above the black level

PatternSequence three_periods(int steps = 3, const std::vector<double>& exposures = {}) {
  SequenceDesign design{1024, 768};
  design.periods_px = {1040, 131, 16.5};
  design.steps = steps;
  design.bits = 0;
  design.exposures = exposures;
  return design_sequence(design);
}

// Images of a slanted surface, the mean of whose pixels is `mean_dn(row, col)` above the black level at the rig's exposure.
// `bias_rad(period)` is added to the phase of fringes and bits; bits combined by XOR have stripes of their carrier's width.
template <class Mean, class Bias>
FringeStack stack_of(const PatternSequence& sequence, const SensorModel& sensor, uint64_t seed, Mean&& mean_dn,
                     Bias&& bias_rad) {
  Random random(seed);
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1b image(kRows, kCols);
    for (int row = 0; row < kRows; ++row) {
      for (int col = 0; col < kCols; ++col) {
        const double u = 120 + 8.3 * col + 0.7 * row;
        const double stripe_px = pattern.carrier_px > 0 ? pattern.carrier_px : pattern.period_px;
        const double shifted = u + stripe_px / (2 * CV_PI) * bias_rad(stripe_px, row, col);
        const double light =
            pattern.exposure * mean_dn(row, col) * (1 + kModulation * (2 * ideal_intensity(pattern, shifted) - 1));
        const double exact = sensor.offset_dn + light;
        const double sigma = std::sqrt(sensor.variance_dn2(exact) - 1.0 / 12);
        image(row, col) = cv::saturate_cast<uchar>(exact + sigma * random.normal());
      }
    }
    images.push_back(image);
  }
  FringeStack stack = support::stack_of(sequence, images);
  for (size_t i = 0; i < images.size(); ++i) stack.exposure_s[i] = 0.01 * sequence.patterns[i].exposure;
  return stack;
}

constexpr auto kUnbiased = [](double, int, int) { return 0.0; };

Advice advice_on(const FringeStack& stack, const RigModel& rig, const AdviceOptions& options = {}) {
  const DecodeOptions decoding;
  return advise({examine(stack, rig, decoding, Axis::columns)}, stack.patterns, rig, decoding, options,
                ObservedMotion::none);
}

auto uniform(double dn) {
  return [dn](int, int) { return dn; };
}

TEST(Advice, PlainSurfaceNeedsOneExposureAndNoMicroPhaseShifting) {
  const RigModel rig;
  const Advice advice = advice_on(stack_of(three_periods(), rig.sensor, 1, uniform(80), kUnbiased), rig);
  EXPECT_EQ(advice.indirect, ObservedIndirect::none);
  EXPECT_EQ(advice.exposures.size(), 1U);
  EXPECT_EQ(advice.coding.name, "multifrequency");
  EXPECT_LE(advice.images, 9);
  EXPECT_FALSE(advice.look_first);
  EXPECT_GT(advice.covered, 0.999);
}

TEST(ExposureIntervals, MoreExposuresThanStepsAreNone) {
  const ExposureIntervals intervals;
  EXPECT_TRUE(intervals.best(2, 5, 5).empty());
  EXPECT_TRUE(intervals.best(1, 5, 4).empty());
  EXPECT_EQ(intervals.best(1, 5, 5), std::vector<int>({5}));
  EXPECT_EQ(intervals.best(2, 5, 6), std::vector<int>({5, 6}));
}

// The advised images decode what they are predicted to decode.
TEST(Advice, CoversBrightAndDarkParts) {
  const RigModel rig;
  for (const double ratio : {40.0, 100.0}) {
    const auto halves = [&](int, int col) { return col < kCols / 2 ? 120.0 : 120 / ratio; };
    const Advice advice = advice_on(stack_of(three_periods(), rig.sensor, 2, halves, kUnbiased), rig);
    ASSERT_EQ(advice.exposures.size(), 2U) << ratio;
    const ExposureChoice present = present_exposures(advice, AdviceOptions().covered);
    EXPECT_EQ(present.exposures, advice.exposures);
    EXPECT_GT(present.covered, 0.98);
    EXPECT_EQ(present_exposures(advice, 0.3).exposures.size(), 1U);
    // In closed form: the brightest value lies below saturation at the short exposure, and the modulation of the dark half
    // above the decoder's minimum at the long one.
    const double clip_dn = DecodeOptions().saturation * rig.sensor.max_dn() - rig.sensor.offset_dn;
    EXPECT_LT(advice.exposures[0] * 120 * (1 + kModulation), clip_dn) << ratio;
    EXPECT_GT(advice.exposures[1] * 120 / ratio * kModulation, DecodeOptions().min_modulation_dn) << ratio;
    // One exposure cannot do both.
    EXPECT_LT(advice.coding.covered.front(), 0.9) << ratio;
    const FringeStack again = stack_of(advised_sequence(advice, three_periods()), rig.sensor, 3, halves, kUnbiased);
    const DecodedStack decoded = decode(again, rig, {});
    const auto valid =
        std::count_if(decoded.coordinate_px.begin(), decoded.coordinate_px.end(), [](float u) { return u == u; });
    EXPECT_GE(static_cast<double>(valid) / (kRows * kCols), 0.99) << ratio;
  }
}

// At the least exposure that is predicted to decode a pixel, nearly all such pixels are decoded (99 % but for the rounding of
// grey values and the residual test); at half of it, far fewer.
TEST(Advice, LeastExposureIsThatOfTheDecoder) {
  const RigModel rig;
  for (const std::vector<double>& periods :
       {std::vector<double>{1041, 16.5}, {1040, 131, 16.5}, {1041, 261, 65.7, 16.5}}) {
    SequenceDesign design{1024, 768};
    design.bits = 0;
    design.periods_px = periods;
    const PatternSequence sequence = design_sequence(design);
    const FringeStack stack = stack_of(sequence, rig.sensor, 15, uniform(80), kUnbiased);
    const Advice bright = advise({examine(stack, rig, {}, Axis::columns)}, sequence, rig, {}, {}, ObservedMotion::none);
    const SignalLimits limits(rig.sensor, {}, bright.alternatives.front().demand, 1);
    ASSERT_TRUE(bright.alternatives.front().current);
    const auto share_at = [&](double exposure) {
      const FringeStack taken = stack_of(sequence, rig.sensor, 16, uniform(80 * exposure), kUnbiased);
      const DecodedStack decoded = decode(taken, rig, {});
      const auto valid =
          std::count_if(decoded.coordinate_px.begin(), decoded.coordinate_px.end(), [](float u) { return u == u; });
      return static_cast<double>(valid) / (kRows * kCols);
    };
    double least = 1.0 / 64;
    while (limits.too_dark(80, 80 * kModulation, least)) least *= 1.02;
    EXPECT_GE(share_at(least), 0.975) << periods.size();
    EXPECT_LT(share_at(least / 2), 0.7) << periods.size();
  }
}

TEST(Advice, DarkSurfaceNeedsALongerExposure) {
  const RigModel rig;
  const Advice advice = advice_on(stack_of(three_periods(), rig.sensor, 4, uniform(2), kUnbiased), rig);
  ASSERT_EQ(advice.exposures.size(), 1U);
  EXPECT_GT(advice.exposures[0] * 2 * kModulation, DecodeOptions().min_modulation_dn);
  EXPECT_LT(advice.exposures[0], 16);
}

// Two of three steps suffice for the brightness of a pixel that saturates in the third.
TEST(Advice, BrightnessOfPartlySaturatedPixelsIsEstimated) {
  const RigModel rig;
  const auto halves = [](int, int col) { return col < kCols / 2 ? 60.0 : 200.0; };
  const PixelLight light =
      survey_light(stack_of(three_periods(), rig.sensor, 5, halves, kUnbiased), rig.sensor, {}, Axis::columns);
  std::vector<float> estimates;
  int hidden = 0;
  for (int row = 0; row < kRows; ++row) {
    for (int col = kCols / 2; col < kCols; ++col) {
      hidden += light.at(row, col) == LightState::hidden;
      if (light.at(row, col) == LightState::estimated) estimates.push_back(light.mean_dn(row, col));
    }
  }
  ASSERT_GT(estimates.size(), 1000U);
  EXPECT_LT(hidden, 300);
  std::sort(estimates.begin(), estimates.end());
  EXPECT_NEAR(static_cast<double>(estimates[estimates.size() / 2]), 200, 10);
}

TEST(Advice, AsksForAShorterLookWhereSaturationHidesTheBrightness) {
  const RigModel rig;
  const auto halves = [](int, int col) { return col < kCols / 2 ? 60.0 : 6000.0; };
  const FringeStack stack = stack_of(three_periods(), rig.sensor, 6, halves, kUnbiased);
  ViewEvidence view = examine(stack, rig, {}, Axis::columns);
  const Advice first = advise({view}, stack.patterns, rig, {}, {}, ObservedMotion::none);
  ASSERT_TRUE(first.look_first);
  EXPECT_LT(*first.look_first, 1);
  EXPECT_NEAR(first.hidden_share, 0.5, 0.02);
  Advice advice = first;
  for (int look = 0; look < 3 && advice.look_first; ++look) {
    PatternSequence shorter = three_periods(3, {*advice.look_first});
    add_look(view, stack_of(shorter, rig.sensor, 7, halves, kUnbiased), rig, {}, Axis::columns);
    advice = advise({view}, stack.patterns, rig, {}, {}, ObservedMotion::none);
  }
  EXPECT_FALSE(advice.look_first);
  ASSERT_GE(advice.exposures.size(), 2U);
  EXPECT_LT(advice.exposures.front() * 6000 * (1 + kModulation), 253);
}

// A bias that neighbours share is not noise. A noise model with too small sigmas does not make noise a bias.
TEST(Advice, DistinguishesIndirectLightFromNoise) {
  RigModel rig;
  const auto biased = [](double period_px, int row, int) { return period_px > 100 ? 0.3 * std::sin(row / 15.0) : 0.0; };
  EXPECT_EQ(advice_on(stack_of(three_periods(), rig.sensor, 8, uniform(80), biased), rig).indirect,
            ObservedIndirect::present);
  const FringeStack stack = stack_of(three_periods(), rig.sensor, 9, uniform(80), kUnbiased);
  const double mean_dn = rig.sensor.offset_dn + 80, variance_dn2 = rig.sensor.variance_dn2(mean_dn);
  rig.sensor.gain_dn_per_electron /= 4;
  rig.sensor.full_well_electrons *= 4;  // at the same gray value
  const ViewEvidence view = examine(stack, rig, {}, Axis::columns);
  EXPECT_NEAR(view.light.noise_ratio, std::sqrt(variance_dn2 / rig.sensor.variance_dn2(mean_dn)), 0.1);
  EXPECT_EQ(advise({view}, stack.patterns, rig, {}, {}, ObservedMotion::none).indirect, ObservedIndirect::none);
}

TEST(Advice, IndirectLightNeedsMicroPhaseShifting) {
  const RigModel rig;
  const auto biased = [](double period_px, int row, int) { return period_px > 100 ? 0.3 * std::sin(row / 15.0) : 0.0; };
  const Advice advice = advice_on(stack_of(three_periods(), rig.sensor, 10, uniform(80), biased), rig);
  EXPECT_EQ(advice.coding.name, "micro");
  EXPECT_EQ(resolve_unwrapping(advised_sequence(advice, three_periods()), rig, {}), Unwrapping::micro);
}

// Micro phase shifting needs more signal than heterodyne phase shifting, which also decodes several exposures.
TEST(Advice, IndirectLightOnBrightAndDarkPartsNeedsBeatsOfShortPeriods) {
  const RigModel rig;
  const auto biased = [](double period_px, int row, int) { return period_px > 100 ? 0.3 * std::sin(row / 15.0) : 0.0; };
  for (const auto& [dark, exposures] : {std::pair{8.0, 1U}, {1.5, 2U}}) {
    const double dark_dn = dark;
    const auto halves = [&](int, int col) { return col < kCols / 2 ? 120.0 : dark_dn; };
    const Advice advice = advice_on(stack_of(three_periods(), rig.sensor, 17, halves, biased), rig);
    ASSERT_EQ(advice.indirect, ObservedIndirect::present);
    ASSERT_EQ(advice.coding.name, "heterodyne");
    EXPECT_EQ(advice.exposures.size(), exposures);
    for (const CodingChoice& choice : advice.alternatives) {
      if (choice.name != "micro") continue;
      EXPECT_LT(choice.covered.front(), advice.covered);
    }
    const PatternSequence advised = advised_sequence(advice, three_periods());
    const double single = exposures == 1 ? advice.exposures.front() : 1;
    const auto exposed = [&](int row, int col) { return single * halves(row, col); };
    const DecodedStack decoded = decode(stack_of(advised, rig.sensor, 18, exposed, biased), rig, {});
    EXPECT_EQ(decoded.unwrapping, Unwrapping::heterodyne);
    const auto valid =
        std::count_if(decoded.coordinate_px.begin(), decoded.coordinate_px.end(), [](float u) { return u == u; });
    EXPECT_GE(static_cast<double>(valid) / (kRows * kCols), 0.99) << dark;
  }
}

// The least exposure that the advice predicts for a Gray code decodes nearly all pixels.
TEST(Advice, LeastExposureOfAGrayCodeIsThatOfTheDecoder) {
  const RigModel rig;
  const Advice bright = advice_on(stack_of(three_periods(), rig.sensor, 15, uniform(80), kUnbiased), rig);
  const auto gray = std::find_if(bright.alternatives.begin(), bright.alternatives.end(),
                                 [](const CodingChoice& choice) { return choice.name == "gray"; });
  ASSERT_NE(gray, bright.alternatives.end());
  EXPECT_THAT(gray->design.gray_xor_px, ElementsAre(16.5));
  const SignalLimits limits(rig.sensor, {}, gray->demand, 1);
  double least = 1.0 / 64;
  while (limits.too_dark(80, 80 * kModulation, least)) least *= 1.02;
  const auto share_at = [&](double exposure) {
    const DecodedStack decoded =
        decode(stack_of(design_sequence(gray->design), rig.sensor, 16, uniform(80 * exposure), kUnbiased), rig, {});
    const auto valid =
        std::count_if(decoded.coordinate_px.begin(), decoded.coordinate_px.end(), [](float u) { return u == u; });
    return static_cast<double>(valid) / (kRows * kCols);
  };
  EXPECT_GE(share_at(least), 0.975);
  EXPECT_LT(share_at(least / 2), 0.8);
}

// A Gray code in use is kept where indirect light cannot be excluded if its stripes are short.
TEST(Advice, GrayCodesOfShortStripesResistIndirectLight) {
  const RigModel rig;
  for (const bool narrow : {false, true}) {
    SequenceDesign design{1024, 768};
    design.periods_px = {16.5};
    design.steps = 4;
    design.gray = GrayCode::complementary;
    if (narrow) design.gray_xor_px = {16.5};
    const Advice advice = advice_on(stack_of(design_sequence(design), rig.sensor, 19, uniform(80), kUnbiased), rig);
    ASSERT_EQ(advice.indirect, ObservedIndirect::unknown);
    ASSERT_TRUE(advice.alternatives.front().current);
    EXPECT_EQ(advice.alternatives.front().resists_indirect, narrow);
    EXPECT_EQ(advice.coding.resists_indirect, narrow);
  }
}

TEST(Advice, NoiseRatioOfARightModelIsOne) {
  const RigModel rig;
  for (const int steps : {3, 5}) {
    const PixelLight light = survey_light(stack_of(three_periods(steps), rig.sensor, 11, uniform(80), kUnbiased),
                                          rig.sensor, {}, Axis::columns);
    EXPECT_NEAR(light.noise_ratio, 1, 0.08) << steps;
  }
}

TEST(Advice, PixelsWithoutFringesAreUnlit) {
  const RigModel rig;
  for (const double black : {0.0, 0.3, 0.5, 0.8}) {  // above a whole number
    SensorModel sensor = rig.sensor;
    sensor.offset_dn += black;
    const PixelLight light =
        survey_light(stack_of(three_periods(), sensor, 12, uniform(0), kUnbiased), rig.sensor, {}, Axis::columns);
    EXPECT_LT(cv::countNonZero(light.state), 0.02 * kRows * kCols) << black;
  }
}

TEST(Advice, MotionKeepsOneExposureAndACodingThatDecodesIt) {
  const RigModel rig;
  const auto halves = [](int, int col) { return col < kCols / 2 ? 120.0 : 1.5; };
  const FringeStack stack = stack_of(three_periods(), rig.sensor, 13, halves, kUnbiased);
  const Advice advice =
      advise({examine(stack, rig, {}, Axis::columns)}, stack.patterns, rig, {}, {}, ObservedMotion::moving);
  EXPECT_THAT(advice.exposures, ElementsAre(1));
  EXPECT_TRUE(advice.coding.decodes_motion);
  EXPECT_EQ(advice.indirect, ObservedIndirect::unknown);
}

TEST(Advice, PatternsWithoutBrightnessAreRefused) {
  const RigModel rig;
  SequenceDesign design{1024, 768};
  design.gray_cell_px = 8;
  const FringeStack stack = stack_of(design_sequence(design), rig.sensor, 14, uniform(80), kUnbiased);
  EXPECT_THAT(error_of([&] { examine(stack, rig, {}, Axis::columns); }), HasSubstr("white and a black image"));
}

// The fewest exposures of known intervals.
TEST(ExposureIntervals, BestMeetsMostIntervals) {
  ExposureIntervals intervals;
  PixelLight light;
  light.mean_dn = light.modulation_dn = light.peak_dn = cv::Mat1f(1, 2);
  light.mean_dn = cv::Mat1f(1, 2, 10.0f);
  light.modulation_dn = cv::Mat1f(1, 2, 10.0f);
  light.peak_dn = cv::Mat1f(1, 2, 20.0f);
  light.mean_dn(0, 1) = light.modulation_dn(0, 1) = 10000;
  light.peak_dn(0, 1) = 20000;
  light.state = cv::Mat1b(1, 2, static_cast<uchar>(LightState::lit));
  light.noise_ratio = 1;
  const SensorModel sensor;
  intervals.add(light, sensor, {}, {});
  EXPECT_EQ(intervals.decodable(), 2);
  EXPECT_EQ(intervals.covered(intervals.best(1, 0, ExposureGrid::kSteps - 1)), 1);
  const std::vector<int> two = intervals.best(2, 0, ExposureGrid::kSteps - 1);
  ASSERT_EQ(two.size(), 2U);
  EXPECT_EQ(intervals.covered(two), 2);
  EXPECT_LT(ExposureGrid::exposure(two[0]) * 20000, 250);
  EXPECT_GT(ExposureGrid::exposure(two[1]) * 10, 3);
  EXPECT_LT(ExposureGrid::exposure(two[1]) * 20, 250);
}

}  // namespace
}  // namespace fringeslam
