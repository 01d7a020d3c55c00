// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/camera_noise.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <random>

#include "core/base/constants.h"
#include "core/decode/exposures.h"
#include "core/patterns/design.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

constexpr int kRows = 240, kCols = 320;

struct Camera {
  double gain = 0.03, dark_noise = 20, offset = 0;
  double saturation_dn = 255;
};

// Distortions of the images in addition to noise.
struct Disturbance {
  double second_harmonic = 0;                          // of the waveform, relative to its modulation
  std::function<double(size_t)> brightness = nullptr;  // factor of an image
  double displacement_px = 0;                          // of the texture
};

PatternSequence periods(const std::vector<double>& periods_px, int steps) {
  return phase_shift_sequence(640, 480, periods_px, steps, Axis::columns, 8);
}

// A textured surface under the patterns; the projector coordinate grows along the rows of the image.
FringeStack capture(const PatternSequence& sequence, const Camera& camera, unsigned seed,
                    const Disturbance& disturbance = {}) {
  std::mt19937 random(seed);
  FringeStack stack;
  stack.patterns = sequence;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    const double brightness = disturbance.brightness ? disturbance.brightness(i) : 1;
    cv::Mat1b image(kRows, kCols);
    for (int row = 0; row < kRows; ++row) {
      for (int col = 0; col < kCols; ++col) {
        const double x = col + disturbance.displacement_px;
        const double albedo = 0.55 + 0.4 * std::sin(0.05 * row) * std::cos(0.04 * x), u = 1.7 * x;
        double light = ideal_intensity(pattern, u);
        if (pattern.coding == Coding::fringe)
          light += 0.5 * disturbance.second_harmonic *
                   std::cos(2 * (kTwoPi * (u + 0.5) / pattern.period_px + pattern.shift_rad));
        const double mean_dn = (8 + 225 * albedo * light) * brightness;
        const double electrons = std::poisson_distribution<int>(mean_dn / camera.gain)(random) +
                                 std::normal_distribution<double>(0, camera.dark_noise)(random);
        const double dn = camera.offset + camera.gain * electrons;
        image(row, col) = cv::saturate_cast<uint8_t>(std::min(dn, camera.saturation_dn));
      }
    }
    stack.images.push_back(image);
    stack.exposure_s.push_back(0.01);
    stack.exposure_time_s.push_back(0.02 * static_cast<double>(i));
  }
  return stack;
}

CameraNoise measure(const std::vector<FringeStack>& stacks) {
  SensorModel prior;
  prior.offset_dn = 0;
  NoiseEstimator estimator(prior, {});
  for (const FringeStack& stack : stacks) estimator.add(stack);
  return estimator.estimate();
}

bool contains(const NoiseInterval& interval, double value) { return interval.low <= value && value <= interval.high; }

TEST(CameraNoise, CountsTheRedundancyOfPatterns) {
  const auto count = [](PatternSequence sequence, const std::vector<Pattern>& more) {
    sequence.patterns.insert(sequence.patterns.end(), more.begin(), more.end());
    return noise_samples_per_pixel(sequence);
  };
  EXPECT_EQ(count(periods({40}, 3), {}), 0);
  EXPECT_EQ(count(periods({40}, 4), {}), 1);
  EXPECT_EQ(count(periods({40}, 12), gray_patterns(Axis::columns, 40, 640, 8)), 9);
  EXPECT_EQ(count(periods({640, 40}, 3), {}), 1);
  EXPECT_EQ(count(periods({640, 40}, 3), phase_shift_sequence(640, 480, {480, 40}, 3, Axis::rows, 8).patterns), 3);
  std::vector<Pattern> gray = gray_patterns(Axis::columns, 80, 640, 8);
  const size_t bits = gray.size();
  for (size_t i = 0; i < bits; ++i) {
    gray.push_back(gray[i]);
    gray.back().inverted = true;
  }
  EXPECT_EQ(count({640, 480, {}}, gray), static_cast<int>(bits) - 1);
}

TEST(CameraNoise, IntervalsContainTheTruthAcrossSeeds) {
  const Camera camera;
  constexpr int kSeeds = 20;
  int gains = 0, dark = 0;
  for (const PatternSequence& sequence : {periods({640, 40}, 3), periods({40}, 6)}) {
    double mean = 0;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
      const CameraNoise noise = measure({capture(sequence, camera, seed)});
      gains += contains(noise.gain_dn_per_electron, camera.gain);
      dark += contains(noise.dark_noise_electrons, camera.dark_noise);
      mean += noise.gain_dn_per_electron.value / kSeeds;
    }
    EXPECT_NEAR(mean / camera.gain, 1, 0.015);
  }
  // 33 of 40 or fewer happen with probability 1e-3 at a coverage of 95 %; the seeds are fixed.
  EXPECT_GT(gains, 33);
  EXPECT_GT(dark, 33);
}

TEST(CameraNoise, OffsetFollowsFromTheMissingVarianceAtBlack) {
  Camera camera;
  camera.offset = 12;
  camera.dark_noise = 5;
  const CameraNoise noise = measure({capture(periods({40}, 8), camera, 1)});
  EXPECT_NEAR(noise.gain_dn_per_electron.value, camera.gain, 0.03 * camera.gain);
  // The variance at black, not offset and dark noise separately, can be measured.
  for (const double grey : {30.0, 60.0, 200.0}) {
    const double truth = camera.gain * (grey - camera.offset) + std::pow(camera.gain * camera.dark_noise, 2) + 1.0 / 12;
    EXPECT_NEAR(noise.sensor.variance_dn2(grey) / truth, 1, 0.05) << grey;
  }
}

TEST(CameraNoise, RepeatedStacksServeWherePatternsAreNotRedundant) {
  const PatternSequence gray{640, 480, gray_patterns(Axis::columns, 5, 640, 8)};
  const Camera camera;
  const CameraNoise noise = measure({capture(gray, camera, 1), capture(gray, camera, 2)});
  EXPECT_EQ(noise.residual_stacks, 0);
  EXPECT_EQ(noise.repeated_stacks, 1);
  EXPECT_NEAR(noise.gain_dn_per_electron.value, camera.gain, 0.03 * camera.gain);
}

TEST(CameraNoise, MovedViewsAreNotCompared) {
  const PatternSequence gray{640, 480, gray_patterns(Axis::columns, 5, 640, 8)};
  Disturbance moved;
  moved.displacement_px = 3;
  EXPECT_THROW(measure({capture(gray, {}, 1), capture(gray, {}, 2, moved)}), Error);
  const CameraNoise noise = measure({capture(periods({40}, 4), {}, 1), capture(periods({40}, 4), {}, 2, moved)});
  EXPECT_EQ(noise.repeated_stacks, 0);
  EXPECT_EQ(noise.residual_stacks, 2);
}

TEST(CameraNoise, WaveformAndFlickerAreNotNoise) {
  const Camera camera;
  Disturbance disturbance;
  disturbance.second_harmonic = 0.06;
  disturbance.brightness = [](size_t image) { return image % 3 == 0 ? 1.02 : 0.99; };
  const CameraNoise noise = measure({capture(periods({40}, 8), camera, 1, disturbance)});
  EXPECT_NEAR(noise.gain_dn_per_electron.value, camera.gain, 0.04 * camera.gain);
  EXPECT_NEAR(noise.harmonics, disturbance.second_harmonic, 0.01);
  EXPECT_GT(noise.flicker, 0.01);
}

TEST(CameraNoise, FindsTheSaturationBelowFullScale) {
  Camera camera;
  camera.saturation_dn = 180;
  EXPECT_NEAR(measure({capture(periods({40}, 8), camera, 1)}).saturation_dn, 180, 2);
  EXPECT_EQ(measure({capture(periods({40}, 8), {}, 1)}).saturation_dn, 255);
}

TEST(CameraNoise, ExplainsWhyItCannotMeasure) {
  EXPECT_THAT(error_of([] { measure({capture(periods({40}, 3), {}, 1)}); }), HasSubstr("no redundancy"));
  FringeStack black = capture(periods({40}, 4), {}, 1);
  for (cv::Mat& image : black.images) image = cv::Mat1b::zeros(image.size());
  EXPECT_THAT(error_of([&] { measure({black}); }), Not(IsEmpty()));
}

// Clipped images are no sinusoid, and their residuals are not noise.
TEST(CameraNoise, GainOfACameraThatClipsBelowFullScale) {
  Camera camera;
  camera.saturation_dn = 130;
  const CameraNoise noise = measure({capture(periods({40}, 8), camera, 1)});
  EXPECT_NEAR(noise.saturation_dn, camera.saturation_dn, 2);
  EXPECT_NEAR(noise.gain_dn_per_electron.value, camera.gain, 0.03 * camera.gain);
  EXPECT_TRUE(contains(noise.gain_dn_per_electron, camera.gain));
  EXPECT_LT(noise.harmonics, 0.01);
}

TEST(CameraNoise, SeveralExposuresAreMeasuredAtOneOfThem) {
  const Camera camera;
  PatternSequence sequence = periods({40}, 6);
  sequence.patterns = at_exposures(sequence.patterns, {0.25, 1});
  Disturbance exposures;
  exposures.brightness = [&](size_t image) { return sequence.patterns[image].exposure; };
  OneExposure one(255);
  std::vector<FringeStack> reduced;
  int gains = 0;
  double mean = 0;
  constexpr int kSeeds = 6;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const FringeStack stack = capture(sequence, camera, seed, exposures);
    EXPECT_THAT(error_of([&] { measure({stack}); }), HasSubstr("several exposures"));
    reduced.push_back(one.of(stack));
    EXPECT_EQ(reduced.back().patterns, periods({40}, 6));
    const NoiseInterval gain = measure({reduced.back()}).gain_dn_per_electron;
    gains += contains(gain, camera.gain);
    mean += gain.value / kSeeds;
  }
  EXPECT_NEAR(mean / camera.gain, 1, 0.015);
  EXPECT_GE(gains, 4);  // fewer happen with probability 2e-3 at a coverage of 95 %
  EXPECT_EQ(measure({reduced[0], reduced[1]}).repeated_stacks, 1);
}

}  // namespace
}  // namespace fringeslam
