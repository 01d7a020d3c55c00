// SPDX-License-Identifier: Apache-2.0
#include "hw/sequence_check.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "core/patterns/design.h"
#include "core/types/error.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

constexpr int kWidth = 160, kHeight = 120, kScreen = 1024;

// A scene with steps, slopes and varying albedo: pixel x sees projector column 3 + 6 x, with jumps, at varying
// contrast.
struct Scene {
  cv::Mat1f column, row, contrast;
  Scene() : column(kHeight, kWidth), row(kHeight, kWidth), contrast(kHeight, kWidth) {
    support::Random random(5);
    for (int r = 0; r < kHeight; ++r) {
      for (int c = 0; c < kWidth; ++c) {
        column(r, c) = static_cast<float>(3 + 6 * c + 25 * (r / 20 % 2) + 0.3 * r);
        row(r, c) = static_cast<float>(5 + 6 * r + 0.2 * c);
        contrast(r, c) = static_cast<float>(40 + 140 * random.uniform(0, 1));
      }
    }
  }

  // Renders a pattern with noise of 1 DN, rounded to 8 bits.
  cv::Mat seen(const Pattern& pattern, uint64_t seed, double gamma) const {
    support::Random random(seed);
    cv::Mat1b image(kHeight, kWidth);
    for (int r = 0; r < kHeight; ++r) {
      for (int c = 0; c < kWidth; ++c) {
        const double at = static_cast<double>(pattern.axis == Axis::columns ? column(r, c) : row(r, c));
        const double light = std::pow(ideal_intensity(pattern, at), gamma);
        image(r, c) = cv::saturate_cast<uchar>(10 + contrast(r, c) * light + random.normal());
      }
    }
    return image;
  }

  std::vector<cv::Mat> seen(const std::vector<Pattern>& patterns, double gamma) const {
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : patterns) images.push_back(seen(pattern, 100 + images.size(), gamma));
    return images;
  }
};

const Pattern kWhite{.coding = Coding::flat, .level = 1}, kBlack{.coding = Coding::flat, .level = 0};

struct Taken {
  std::vector<Pattern> shown;  // white, black, then the sequence, as the camera sees it
  double gamma = 1;            // of the projector's light
  SequenceVerdict judged(const PatternSequence& sequence) const {
    static const Scene scene;
    std::vector<cv::Mat> images = scene.seen(shown, gamma);
    const cv::Mat white = images[0], black = images[1];
    images.erase(images.begin(), images.begin() + 2);
    return check_sequence(sequence, images, white, black);
  }
};

std::vector<Pattern> all_of(const PatternSequence& sequence) {
  std::vector<Pattern> all = {kWhite, kBlack};
  all.insert(all.end(), sequence.patterns.begin(), sequence.patterns.end());
  return all;
}

struct Case {
  SequenceDesign design;
  double gamma = 1;
};

class Sequences : public testing::TestWithParam<Case> {
 protected:
  SequenceVerdict judged(const std::vector<Pattern>& shown) const {
    return Taken{shown, GetParam().gamma}.judged(sequence_);
  }
  PatternSequence sequence_ = design_sequence(GetParam().design);
};

SequenceDesign design(std::vector<double> periods, GrayCode gray = GrayCode::none, int steps = 3) {
  SequenceDesign wanted;
  wanted.width = kScreen, wanted.height = 768;
  wanted.periods_px = std::move(periods);
  wanted.steps = steps;
  wanted.gray = gray;
  wanted.gray_inverted = gray != GrayCode::none;
  return wanted;
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const double gamma : {1.0, 2.2, 0.6}) {
    all.push_back({design({1040, 131, 16.5}), gamma});
    all.push_back({design({1040, 130, 16.25}, GrayCode::none, 4), gamma});
    all.push_back({design({1040}), gamma});
    all.push_back({design({1040}, GrayCode::none, 8), gamma});
    all.push_back({design({64}, GrayCode::complementary), gamma});
    SequenceDesign others = design({1040, 131, 16.5});
    others.extra_periods_px = {21.1, 20.3};
    others.product_periods_px = {64};
    others.carrier_px = 14;
    all.push_back({others, gamma});
  }
  return all;
}

INSTANTIATE_TEST_SUITE_P(Designs, Sequences, testing::ValuesIn(cases()));

TEST_P(Sequences, AsAskedForAreGoodAndTellTheResponse) {
  const SequenceVerdict verdict = judged(all_of(sequence_));
  EXPECT_TRUE(verdict.good) << verdict.reason;
  EXPECT_NEAR(verdict.gamma, GetParam().gamma, 0.02 * GetParam().gamma);
}

TEST_P(Sequences, ARepeatedPatternIsFoundOut) {
  for (size_t i = 1; i < sequence_.patterns.size() + 2; ++i) {
    std::vector<Pattern> shown = all_of(sequence_);
    shown[i] = shown[i - 1];  // the projector did not change
    EXPECT_FALSE(judged(shown).good) << "image " << i;
  }
}

TEST_P(Sequences, ASkippedPatternIsFoundOut) {
  for (size_t i = 0; i < sequence_.patterns.size() + 1; ++i) {
    std::vector<Pattern> shown = all_of(sequence_);
    shown.erase(shown.begin() + static_cast<std::ptrdiff_t>(i));  // all following images are one too early
    shown.push_back(kWhite);                                      // then the next sequence begins
    EXPECT_FALSE(judged(shown).good) << "image " << i;
  }
}

TEST_P(Sequences, ALateSequenceIsFoundOut) {
  std::vector<Pattern> shown = all_of(sequence_);
  std::rotate(shown.rbegin(), shown.rbegin() + 1, shown.rend());
  EXPECT_FALSE(judged(shown).good);
}

// A repeated image of a ramp leaves a step of the brightness out.
TEST(SequenceCheck, ARepeatedImageOfARampIsFoundOut) {
  SequenceDesign wanted = design({64, 8}, GrayCode::none);
  wanted.ramp_levels = 17;
  const PatternSequence sequence = design_sequence(wanted);
  for (const double gamma : {0.6, 1.0, 2.2}) {
    const Scene scene;
    const std::vector<cv::Mat> images = scene.seen(sequence.patterns, gamma);
    const cv::Mat white = scene.seen(kWhite, 1, gamma), black = scene.seen(kBlack, 2, gamma);
    const SequenceVerdict verdict = check_sequence(sequence, images, white, black);
    EXPECT_TRUE(verdict.good) << verdict.reason;
    // Levels that a gamma of 2.2 leaves nearly black are alike.
    for (size_t i = sequence.patterns.size() - 13; i < sequence.patterns.size(); ++i) {
      std::vector<cv::Mat> repeated = images;
      repeated[i] = images[i - 1];
      EXPECT_FALSE(check_sequence(sequence, repeated, white, black).good) << gamma << ", image " << i;
    }
  }
}

// On an object that the coarse bits do not divide, two of them are constant and equal. A repeated bit that changes there is
// still found.
TEST(SequenceCheck, CoarseBitsMayBeConstantOnASmallObject) {
  Scene scene;
  for (int r = 0; r < kHeight; ++r) {
    for (int c = 0; c < kWidth; ++c) {
      if (!(scene.column(r, c) > kScreen / 2.0f + 4 && scene.column(r, c) < 0.75f * kScreen - 4))
        scene.contrast(r, c) = 0;
    }
  }
  const PatternSequence sequence = design_sequence(design({64}, GrayCode::plain));
  std::vector<cv::Mat> images = scene.seen(sequence.patterns, 1);
  const cv::Mat white = scene.seen(kWhite, 1, 1), black = scene.seen(kBlack, 2, 1);
  const SequenceVerdict verdict = check_sequence(sequence, images, white, black);
  EXPECT_TRUE(verdict.good) << verdict.reason;
  images[images.size() - 1] = images[images.size() - 3];
  EXPECT_FALSE(check_sequence(sequence, images, white, black).good);
}

// Limits are relative to the camera's full scale: saturated pixels of a 12-bit camera are not used, nor is its noise.
TEST(SequenceCheck, LimitsFollowTheBitsOfTheCamera) {
  Scene scene;
  support::Random random(9);
  for (int r = 0; r < kHeight; ++r) {
    for (int c = 0; c < kWidth; ++c) scene.contrast(r, c) = c < kWidth / 2 ? 600 : c < 0.7 * kWidth ? 120 : 0;
  }
  const PatternSequence sequence = design_sequence(design({1040, 131, 16.5}));
  const auto seen = [&](const Pattern& pattern) {
    cv::Mat1w image(kHeight, kWidth);
    for (int r = 0; r < kHeight; ++r) {
      for (int c = 0; c < kWidth; ++c) {
        const double light = scene.contrast(r, c) * ideal_intensity(pattern, scene.column(r, c));
        image(r, c) = static_cast<uint16_t>(std::clamp(16 * (10 + light + random.normal()), 0.0, 4095.0));
      }
    }
    return cv::Mat(image);
  };
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) images.push_back(seen(pattern));
  SequenceCheckOptions options;
  options.full_scale_dn = 4095;
  const SequenceVerdict verdict = check_sequence(sequence, images, seen(kWhite), seen(kBlack), options);
  EXPECT_TRUE(verdict.good) << verdict.reason;
}

TEST(SequenceCheck, DarknessIsNoSequence) {
  const PatternSequence sequence = design_sequence(design({1040, 131, 16.5}));
  const cv::Mat dark(kHeight, kWidth, CV_8UC1, cv::Scalar(3));
  const SequenceVerdict verdict = check_sequence(sequence, std::vector<cv::Mat>(9, dark), dark, dark);
  EXPECT_FALSE(verdict.good);
  EXPECT_THAT(verdict.reason, testing::HasSubstr("is the projector on"));
}

// The mean of ((1 + cos s) / 2)^n over a turn is (2n)! / (4^n n!^2): 1/2, 3/8, 5/16 for n = 1, 2, 3.
TEST(SequenceCheck, TheMeanOfFringesYieldsTheGamma) {
  EXPECT_NEAR(gamma_of_mean(1.0 / 2), 1, 1e-6);
  EXPECT_NEAR(gamma_of_mean(3.0 / 8), 2, 1e-6);
  EXPECT_NEAR(gamma_of_mean(5.0 / 16), 3, 1e-6);
  EXPECT_THROW(gamma_of_mean(0.1), Error);
  EXPECT_THROW(gamma_of_mean(std::nan("")), Error);
}

// Judges the sequence as it is and with each image from `first` on replaced by the one before it.
void expect_repeats_found(const PatternSequence& sequence, const Scene& scene, double gamma, size_t first = 1) {
  const std::vector<cv::Mat> images = scene.seen(sequence.patterns, gamma);
  const cv::Mat white = scene.seen(kWhite, 1, gamma), black = scene.seen(kBlack, 2, gamma);
  const SequenceVerdict verdict = check_sequence(sequence, images, white, black);
  EXPECT_TRUE(verdict.good) << "gamma " << gamma << ": " << verdict.reason;
  for (size_t i = first; i < images.size(); ++i) {
    std::vector<cv::Mat> repeated = images;
    // Another image of the pattern before it, with noise of its own.
    repeated[i] = i > 0 ? scene.seen(sequence.patterns[i - 1], 500 + i, gamma) : scene.seen(kBlack, 500, gamma);
    EXPECT_FALSE(check_sequence(sequence, repeated, white, black).good) << "gamma " << gamma << ", image " << i;
  }
}

// A dropped first row bit leaves the last column bit on the screen.
TEST(SequenceCheck, ARepeatedBitOfTheOtherAxisIsFoundOut) {
  SequenceDesign wanted = design({});
  wanted.rows = true;
  wanted.gray_cell_px = 16;
  wanted.white_black = true;
  const PatternSequence sequence = design_sequence(wanted);
  ASSERT_TRUE(std::any_of(sequence.patterns.begin(), sequence.patterns.end(),
                          [](const Pattern& of) { return of.coding == Coding::gray && of.axis == Axis::rows; }));
  expect_repeats_found(sequence, Scene(), 1);
}

// The root of the summed squared residuals grows with the number of images and the noise.
// A repeated image of N changes a sample by at most sin(pi / N) of the contrast, which hardly disturbs the cosine.
TEST(SequenceCheck, ARepeatedImageOfManyPhaseStepsIsFoundOut) {
  Scene dark;
  dark.contrast = 20;
  for (const double gamma : {0.6, 1.0, 2.2}) {
    for (const int steps : {8, 18, 32}) {
      const PatternSequence sequence = design_sequence(design({64}, GrayCode::none, steps));
      expect_repeats_found(sequence, Scene(), gamma, 0);
      expect_repeats_found(sequence, dark, gamma, 0);
    }
  }
}

// Nothing locates the pixels. With noise of 1 DN, 16 % of them differ by more than a tenth of 20 DN in images of the same
// pattern. The first pattern follows the black image.
TEST(SequenceCheck, ARepeatedWaveIsFoundOutInTheDark) {
  Scene dark;
  dark.contrast = 20;
  SequenceDesign micro = design({}), modulated = design({}), products = design({});
  micro.micro_period_px = 24;
  modulated.modulated_period_px = 24;
  products.product_periods_px = {64};
  products.carrier_px = 14;
  for (const SequenceDesign& wanted : {micro, modulated, products})
    expect_repeats_found(design_sequence(wanted), dark, 1, 0);
}

// The images of white and black are shown with the same inverse response as the patterns.
TEST(SequenceCheck, FlatImagesOfALinearizedSequenceAreChecked) {
  SequenceDesign wanted = design({1040, 131});
  wanted.white_black = true;
  PatternSequence sequence = design_sequence(wanted);
  sequence.inverse_response = {0.1, 0.6, 0.9};
  expect_repeats_found(sequence, Scene(), 1);
}

TEST(SequenceCheck, AnOverexposedSceneIsSaturated) {
  Scene bright;
  bright.contrast *= 20.0f;  // at least 800 DN
  const PatternSequence sequence = design_sequence(design({1040, 131, 16.5}));
  const std::vector<cv::Mat> images = bright.seen(sequence.patterns, 1);
  const SequenceVerdict verdict =
      check_sequence(sequence, images, bright.seen(kWhite, 1, 1), bright.seen(kBlack, 2, 1));
  EXPECT_FALSE(verdict.good);
  EXPECT_TRUE(verdict.too_few_pixels);
  EXPECT_TRUE(verdict.saturated);
  EXPECT_THAT(verdict.reason, testing::AllOf(testing::HasSubstr("100 % of the pixels are saturated in white"),
                                             testing::HasSubstr("lower exposure")));
}

}  // namespace
}  // namespace fringeslam
