// SPDX-License-Identifier: Apache-2.0
// Images of one pattern at several exposures: samples used, the estimator's distribution, and the phases.
#include "core/decode/exposures.h"

#include <gmock/gmock.h>

#include <cmath>

#include "core/decode/decode.h"
#include "core/patterns/design.h"
#include "core/patterns/waveform.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::Random;
using testing::HasSubstr;

constexpr double kRigExposure_s = 0.01, kClip_dn = 0.98 * 255;

SequenceDesign design_of(const std::vector<double>& exposures) {
  SequenceDesign design{1024, 768};
  design.periods_px = {1040, 131, 16.5};
  design.steps = 4;
  design.bits = 0;
  design.exposures = exposures;
  return design;
}

// Images of pixels that receive `mean_dn[i]` +- 80 % at the rig's exposure and see coordinate_px[i], from a projector of this
// gamma.
FringeStack bracketed(const PatternSequence& sequence, const std::vector<double>& coordinate_px,
                      const std::vector<double>& mean_dn, const SensorModel& sensor, Random& random, double gamma = 1) {
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1b image(1, static_cast<int>(mean_dn.size()));
    for (int i = 0; i < image.cols; ++i) {
      const auto k = static_cast<size_t>(i);
      const double light =
          mean_dn[k] * (1 + 0.8 * (2 * std::pow(ideal_intensity(pattern, coordinate_px[k]), gamma) - 1));
      const double exact = sensor.offset_dn + pattern.exposure * light;
      image(i) = cv::saturate_cast<uchar>(exact + std::sqrt(sensor.variance_dn2(exact) - 1.0 / 12) * random.normal());
    }
    images.push_back(image);
  }
  FringeStack stack = support::stack_of(sequence, images);
  for (size_t i = 0; i < images.size(); ++i) stack.exposure_s[i] = kRigExposure_s * sequence.patterns[i].exposure;
  return stack;
}

PatternSequence flat(const std::vector<double>& exposures) {
  SequenceDesign design{64, 48};
  design.white_black = true;
  design.exposures = exposures;
  PatternSequence sequence = design_sequence(design);
  sequence.patterns.resize(exposures.size());  // white alone
  return sequence;
}

TEST(Exposures, DesignRepeatsEachPatternAndRefusesEqualExposures) {
  const PatternSequence sequence = design_sequence(design_of({1, 4, 16})), once = design_sequence(design_of({}));
  ASSERT_EQ(sequence.patterns.size(), 3 * once.patterns.size());
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    Pattern pattern = sequence.patterns[i];
    EXPECT_EQ(pattern.exposure, (std::vector<double>{1, 4, 16})[i % 3]);
    pattern.exposure = 1;
    EXPECT_EQ(pattern, once.patterns[i / 3]);
  }
  EXPECT_THAT(error_of([] { design_sequence(design_of({1, 4, 4})); }), HasSubstr("one of them is 4"));
}

// The estimate is unbiased with the stated variance wherever at least one exposure is not saturated.
TEST(Exposures, CombinedValueHasTheStatedVariance) {
  constexpr int kPixels = 20000;
  const SensorModel sensor;
  const PatternSequence sequence = flat({1, 4, 16});
  Random random(3);
  // At the rig's exposure, of which white shows 1.8; spread over several grey values, so that rounding is random.
  for (const double light_dn : {0.5, 4.0, 11.0, 40.0, 80.0}) {
    std::vector<double> lights_dn;
    for (int i = 0; i < kPixels; ++i) lights_dn.push_back(light_dn * (0.5 + static_cast<double>(i) / kPixels));
    const FringeStack stack = bracketed(sequence, std::vector<double>(kPixels, 10), lights_dn, sensor, random);
    const CombinedExposures combined = combine_exposures(stack, sensor, kClip_dn);
    ASSERT_EQ(combined.stack.images.size(), 1U);
    double sum = 0, squares = 0;
    for (int i = 0; i < kPixels; ++i) {
      const double error = static_cast<double>(combined.stack.images[0].at<float>(0, i)) - sensor.offset_dn -
                           1.8 * lights_dn[static_cast<size_t>(i)];
      const double z = error / std::sqrt(static_cast<double>(combined.variance_dn2[0](0, i)));
      sum += z;
      squares += z * z;
    }
    EXPECT_NEAR(sum / kPixels, 0, 0.06) << light_dn;
    EXPECT_NEAR(squares / kPixels, 1, 0.08) << light_dn;
  }
}

TEST(Exposures, SaturatedSamplesAreNotUsed) {
  const SensorModel sensor;
  const PatternSequence sequence = flat({1, 4});
  const auto value = [&](uchar shorter, uchar longer) {
    FringeStack stack = support::stack_of(sequence, {cv::Mat1b(1, 1, shorter), cv::Mat1b(1, 1, longer)});
    stack.exposure_s = {kRigExposure_s, 4 * kRigExposure_s};
    const CombinedExposures combined = combine_exposures(stack, sensor, kClip_dn);
    return combined.stack.images[0].at<float>(0, 0) / combined.clip_dn;
  };
  const auto clip = static_cast<float>(kClip_dn);
  EXPECT_NEAR(value(100, 255) * clip, 100, 0.01);
  EXPECT_NEAR(value(100, 240) * clip, 100, 0.01);  // 4 x 98 is saturated, whatever the long exposure claims
  EXPECT_GT(value(255, 255), 1);
  EXPECT_LT(value(249, 255), 1);
}

// From dark rubber to metal, the errors of the coordinate have the stated sigma.
TEST(Exposures, CoordinatesAreHonestOverTheDynamicRange) {
  constexpr int kPixels = 6000;
  RigModel rig;
  const PatternSequence sequence = design_sequence(design_of({1, 4, 16}));
  std::vector<double> coordinate_px, mean_dn;
  for (int i = 0; i < kPixels; ++i) {
    coordinate_px.push_back(20 + 980.0 * i / kPixels);
    mean_dn.push_back(0.8 * std::pow(160, (i * 7919 % kPixels) / static_cast<double>(kPixels)));
  }
  Random random(5);
  const DecodedStack decoded = decode(bracketed(sequence, coordinate_px, mean_dn, rig.sensor, random), rig, {});
  int valid = 0, beyond = 0;
  double squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const auto estimate = static_cast<double>(decoded.coordinate_px(0, i));
    if (std::isnan(estimate)) continue;
    const double z = (estimate - coordinate_px[static_cast<size_t>(i)]) / static_cast<double>(decoded.sigma_px(0, i));
    ++valid;
    beyond += std::abs(z) > 4;
    squares += z * z;
  }
  EXPECT_GT(valid, 0.99 * kPixels);
  EXPECT_LE(beyond, 6);
  EXPECT_NEAR(squares / valid, 1, 0.1);
}

// Bright steps come from the short exposure alone. Weighted by their variances, steps would not cancel the harmonics of the
// projector as they do in its correction.
TEST(Exposures, ProjectorsAreCorrected) {
  constexpr int kPixels = 6000;
  constexpr double kGamma = 2.2, kPeriod_px = 1040;
  SequenceDesign design = design_of({1, 8});
  design.periods_px = {kPeriod_px};
  const PatternSequence sequence = design_sequence(design);
  RigModel rig;
  rig.phase_correction = phase_correction_of(gamma_table(kGamma), 4);
  std::vector<double> coordinate_px;
  for (int i = 0; i < kPixels; ++i) coordinate_px.push_back(20 + 980.0 * i / kPixels);
  Random random(6);
  const FringeStack stack =
      bracketed(sequence, coordinate_px, std::vector<double>(kPixels, 60), rig.sensor, random, kGamma);
  const DecodedStack decoded = decode(stack, rig, {});
  int valid = 0;
  double squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const double error = static_cast<double>(decoded.coordinate_px(0, i)) - coordinate_px[static_cast<size_t>(i)];
    if (std::isnan(error)) continue;
    ++valid;
    squares += std::pow(error / static_cast<double>(decoded.sigma_px(0, i)), 2);
  }
  EXPECT_GT(valid, 0.99 * kPixels);
  EXPECT_NEAR(squares / valid, 1, 0.1);
}

// Twelve steps at six exposures are 72 images, but twelve steps to the decoder, which takes 64 at most.
TEST(Exposures, TheirImagesAreNoMoreSteps) {
  SequenceDesign design = design_of({0.25, 0.5, 1, 2, 4, 8});
  design.periods_px = {1040};
  design.steps = 12;
  const PatternSequence sequence = design_sequence(design);
  ASSERT_EQ(sequence.patterns.size(), 72U);
  EXPECT_EQ(resolve_unwrapping(sequence, RigModel(), {}), Unwrapping::multifrequency);
  Random random(7);
  const std::vector<double> coordinate_px = {100, 400, 900};
  const FringeStack stack = bracketed(sequence, coordinate_px, {4, 20, 80}, {}, random);
  for (const int steps : {0, 4}) {
    DecodeOptions options;
    options.steps = steps;
    const DecodedStack decoded = decode(stack, RigModel(), options);
    for (int i = 0; i < 3; ++i)
      EXPECT_NEAR(decoded.coordinate_px(0, i), coordinate_px[static_cast<size_t>(i)], 5 * decoded.sigma_px(0, i)) << i;
  }
}

TEST(Exposures, GrayCodeIsRefusedWithTheReason) {
  SequenceDesign design{1024, 768};
  design.gray_cell_px = 8;
  design.exposures = {1, 4};
  const PatternSequence sequence = design_sequence(design);
  Random random(1);
  const FringeStack stack = bracketed(sequence, {10}, {50}, {}, random);
  EXPECT_THAT(error_of([&] {
                DecodeOptions options;
                options.unwrapping = Unwrapping::gray;
                decode(stack, RigModel(), options);
              }),
              HasSubstr("several exposures"));
}

}  // namespace
}  // namespace fringeslam
