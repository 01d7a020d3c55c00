// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/response.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "core/patterns/patterns.h"
#include "core/patterns/waveform.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::Random;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr double kGamma = 2.2;

SensorModel sensor() {
  SensorModel s;
  s.gain_dn_per_electron = 0.0068;
  return s;
}

// Grey values of one image of a board with spatially varying brightness in ambient light.
template <class Light>
cv::Mat1f image_of(const Light& light, Random& random, bool noise) {
  cv::Mat1f image(60, 80);
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) {
      const double white = 120 + 60 * std::sin(0.1 * row) * std::cos(0.07 * col);
      const double grey = 8 + white * light(row, col);
      const double noisy = grey + (noise ? std::sqrt(sensor().variance_dn2(grey)) * random.normal() : 0);
      image(row, col) = static_cast<float>(noise ? std::round(noisy) : noisy);
    }
  }
  return image;
}

struct Ramp {
  std::vector<cv::Mat1f> images;
  std::vector<double> levels;
};
Ramp ramp(int count, bool noise, uint64_t seed = 1) {
  Random random(seed);
  Ramp result;
  for (int k = 0; k < count; ++k) {
    const double level = k / (count - 1.0);
    result.levels.push_back(level);
    result.images.push_back(image_of([&](int, int) { return std::pow(level, kGamma); }, random, noise));
  }
  return result;
}

struct Fringes {
  std::vector<cv::Mat1f> images;
  std::vector<double> shifts;
};
Fringes fringes(int steps, bool noise, double first = -1.0) {
  Random random(3);
  Fringes result;
  for (int k = 0; k < steps; ++k) {
    result.shifts.push_back(first + 2 * kPi * k / steps);
    result.images.push_back(image_of(
        [&](int row, int col) {
          return std::pow(0.5 + 0.5 * std::cos(0.37 * col + 0.05 * row + result.shifts.back()), kGamma);
        },
        random, noise));
  }
  return result;
}

double worst_off_gamma(const std::vector<double>& table) {
  double worst = 0;
  for (size_t i = 0; i < table.size(); ++i)
    worst = std::max(
        worst, std::abs(table[i] - std::pow(static_cast<double>(i) / static_cast<double>(table.size() - 1), kGamma)));
  return worst;
}

TEST(ResponseFromRamp, RecoversAPowerLaw) {
  const Ramp exact = ramp(33, false);
  const Response response = response_from_ramp(exact.images, exact.levels, sensor(), {});
  EXPECT_LT(worst_off_gamma(response.table), 5e-4);  // monotone cubic interpolation between the levels
  EXPECT_NEAR(response.gamma, kGamma, 1e-3);
  EXPECT_EQ(response.table.front(), 0);
  EXPECT_EQ(response.table.back(), 1);
  const Ramp noisy = ramp(33, true);
  EXPECT_LT(worst_off_gamma(response_from_ramp(noisy.images, noisy.levels, sensor(), {}).table), 2e-3);
}

TEST(ResponseFromRamp, ImagesInAnyOrderAndLevelsTwiceAreFine) {
  Ramp shuffled = ramp(17, false);
  std::reverse(shuffled.images.begin(), shuffled.images.end());
  std::reverse(shuffled.levels.begin(), shuffled.levels.end());
  shuffled.images.push_back(shuffled.images[4]);
  shuffled.levels.push_back(shuffled.levels[4]);
  EXPECT_LT(worst_off_gamma(response_from_ramp(shuffled.images, shuffled.levels, sensor(), {}).table), 2e-3);
}

TEST(ResponseFromRamp, SigmasAreTheScatterOverSeeds) {
  std::vector<double> light;
  double predicted = 0;
  for (uint64_t seed = 1; seed <= 60; ++seed) {
    const Ramp noisy = ramp(9, true, seed);
    const Response response = response_from_ramp(noisy.images, noisy.levels, sensor(), {});
    light.push_back(response.light[5]);
    predicted += response.sigma[5] / 60;
  }
  double mean = 0, squares = 0;
  for (const double x : light) mean += x / 60;
  for (const double x : light) squares += (x - mean) * (x - mean) / 59;
  EXPECT_NEAR(std::sqrt(squares) / predicted, 1, 0.35);
}

TEST(ResponseFromFringes, RecoversAPowerLaw) {
  for (const int steps : {12, 16}) {
    const Fringes seen = fringes(steps, false);
    const Response response = response_from_fringes(seen.images, seen.shifts, sensor(), {});
    EXPECT_LT(worst_off_gamma(response.table), 5e-3) << steps;
  }
  const Fringes noisy = fringes(12, true);
  EXPECT_LT(worst_off_gamma(response_from_fringes(noisy.images, noisy.shifts, sensor(), {}).table), 1e-2);
}

TEST(PhaseCorrectionFromFringes, IsTheClosedFormOfThePowerLaw) {
  // docs/method.md, section 3.3: d phi = (r4 - r2) sin 3 phi to first order; the full arctangent is used here, for
  // centred steps.
  for (const double first : {-1.0, 0.3, -2 * kPi / 3}) {
    const Fringes seen = fringes(12, false, first);
    const PhaseCorrection table = phase_correction_from_fringes(seen.images, seen.shifts, 3, sensor(), {});
    ASSERT_EQ(table.steps, 3);
    double worst = 0, largest = 0;
    for (size_t i = 0; i < table.offset_rad.size(); ++i) {
      const double phase = 2 * kPi * static_cast<double>(i) / static_cast<double>(table.offset_rad.size());
      double s = 0, c = 0;
      for (const double shift : {-2 * kPi / 3, 0.0, 2 * kPi / 3}) {
        const double grey = std::pow(0.5 + 0.5 * std::cos(phase + shift), kGamma);
        s -= grey * std::sin(shift);
        c += grey * std::cos(shift);
      }
      worst = std::max(worst, std::abs(std::remainder(std::atan2(s, c) - phase, 2 * kPi) - table.offset_rad[i]));
      largest = std::max(largest, std::abs(table.offset_rad[i]));
    }
    EXPECT_LT(worst, 0.01) << first;
    EXPECT_NEAR(largest, 0.29, 0.01);
  }
}

// Images of a sequence on a slanted board, behind a power law.
std::vector<cv::Mat> periods(const PatternSequence& sequence, double gamma, bool noise, uint64_t seed = 1) {
  Random random(seed);
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) {
    const cv::Mat1f image = image_of(
        [&](int row, int col) {
          const double coordinate = 40 + 11.7 * col + 0.31 * row + 0.02 * col * row;
          return std::pow(ideal_intensity(pattern, coordinate), gamma);
        },
        random, noise);
    images.push_back(image);
  }
  return images;
}

TEST(PhaseCorrectionOf, IsZeroForALinearResponseAndAgreesWithTheHarmonics) {
  EXPECT_LT(largest_offset_rad(phase_correction_of({0, 1}, 3)), 1e-12);
  EXPECT_LT(largest_offset_rad(phase_correction_of({}, 4)), 1e-12);
  // docs/method.md, section 3.3: r4 - r2 of a power law, to first order.
  const double gamma = 1.2, r2 = (gamma - 1) / (gamma + 2), r3 = r2 * (gamma - 2) / (gamma + 3);
  const double r4 = r3 * (gamma - 3) / (gamma + 4);
  const PhaseCorrection correction = phase_correction_of(gamma_table(gamma), 3);
  EXPECT_NEAR(correction.offset_rad[30], r4 - r2, 0.02 * r2);  // at 30 degrees, where sin 3 phi is 1
  EXPECT_NEAR(correction.offset_rad[60], 0, 1e-3);
  // A response and its inverse are linear together.
  const std::vector<double> both = composed_table(gamma_table(2.2), gamma_table(1 / 2.2, 1025));
  EXPECT_LT(largest_offset_rad(phase_correction_of(both, 3)), 1e-3);
}

TEST(PeriodDeviations, ShowTheGammaOfThreeAndFourSteps) {
  for (const int steps : {3, 4}) {
    for (const double gamma : {0.7, 1.0, 1.4, 2.2}) {
      const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, steps, Axis::columns, 0);
      for (const bool noise : {false, true}) {
        const auto images = periods(sequence, gamma, noise);
        const auto deviations = period_deviations(images, sequence, Axis::columns, sensor(), {});
        ASSERT_EQ(deviations.size(), 2U) << steps << ' ' << gamma;
        EXPECT_EQ(deviations[0].period_px, 1040);
        // The finest period's own error averages out over the coarser phase.
        const PhaseCorrection expected = phase_correction_of(gamma_table(gamma), steps);
        for (const PeriodDeviation& deviation : deviations) {
          EXPECT_EQ(deviation.correction.steps, steps);
          double worst = 0;
          for (size_t i = 0; i < expected.offset_rad.size(); ++i)
            worst = std::max(worst, std::abs(expected.offset_rad[i] - deviation.correction.offset_rad[i]));
          EXPECT_LT(worst, 0.02 + 0.08 * largest_offset_rad(expected)) << steps << ' ' << gamma << ' ' << noise;
        }
        const Response response = response_from_deviations(deviations, {});
        EXPECT_NEAR(response.gamma, gamma, 0.06) << steps << ' ' << noise;
      }
    }
  }
}

TEST(PeriodDeviations, AreSmallComparedWithTheirSigmaWithoutHarmonics) {
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 0);
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    for (const auto& deviation :
         period_deviations(periods(sequence, 1, true, seed), sequence, Axis::columns, sensor(), {}))
      EXPECT_LT(deviation.rms_rad, 5 * deviation.sigma_rad + 2e-3);
  }
  // Nothing can be compared: one period, or none that covers the projector's image.
  const PatternSequence one = phase_shift_sequence(1024, 768, {1040}, 3, Axis::columns, 0);
  EXPECT_TRUE(period_deviations(periods(one, 2, false), one, Axis::columns, sensor(), {}).empty());
  const PatternSequence fine = phase_shift_sequence(1024, 768, {131, 16.5}, 3, Axis::columns, 0);
  EXPECT_TRUE(period_deviations(periods(fine, 2, false), fine, Axis::columns, sensor(), {}).empty());
  EXPECT_THAT(error_of([&] { response_from_deviations({}, {}); }), HasSubstr("no period has enough usable pixels"));
}

TEST(ResponseErrors, SayWhatIsWrongWithTheImages) {
  const auto error = [&](const Ramp& r) {
    return error_of([&] { response_from_ramp(r.images, r.levels, sensor(), {}); });
  };
  Ramp bad = ramp(9, false);
  for (cv::Mat1f& image : bad.images) image *= 3.0;
  EXPECT_THAT(error(bad), HasSubstr("saturated"));
  bad = ramp(9, false);
  for (cv::Mat1f& image : bad.images) image *= 0.05;
  EXPECT_THAT(error(bad), HasSubstr("too dark; increase the exposure time"));
  bad = ramp(9, false);
  bad.levels.back() = 0.9;
  EXPECT_THAT(error(bad), HasSubstr("end with white"));
  bad = ramp(9, false);
  std::swap(bad.images[3], bad.images[6]);
  EXPECT_THAT(error(bad), HasSubstr("the light decreases from"));
  bad.images.resize(3);
  bad.levels.resize(3);
  EXPECT_THAT(error(bad), HasSubstr("at least 5 images"));
  const Fringes few = fringes(6, false);
  EXPECT_THAT(error_of([&] { response_from_fringes(few.images, few.shifts, sensor(), {}); }),
              HasSubstr("at least 8 images"));
  const Fringes ten = fringes(10, false);
  EXPECT_THAT(error_of([&] { phase_correction_from_fringes(ten.images, ten.shifts, 3, sensor(), {}); }),
              HasSubstr("requires a larger multiple"));
  // Three shifts shown three times are no nine steps.
  Fringes thrice = fringes(3, false);
  for (size_t k = 0; k < 6; ++k) {
    thrice.images.push_back(thrice.images[k].clone());
    thrice.shifts.push_back(thrice.shifts[k]);
  }
  EXPECT_THAT(error_of([&] { response_from_fringes(thrice.images, thrice.shifts, sensor(), {}); }),
              HasSubstr("the 9 phase shifts are not equally spaced"));
  EXPECT_THAT(error_of([&] { phase_correction_from_fringes(thrice.images, thrice.shifts, 3, sensor(), {}); }),
              HasSubstr("the 9 phase shifts are not equally spaced"));
}

}  // namespace
}  // namespace fringeslam
