// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/patterns.h"

#include <gmock/gmock.h>

#include <numbers>
#include <numeric>

#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

std::vector<double> shifts_of(const PatternSequence& sequence) {
  std::vector<double> shifts;
  for (const Pattern& pattern : sequence.patterns) shifts.push_back(pattern.shift_rad);
  return shifts;
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
  // Period 4: phases 45, 135, 225, 315 degrees at the pixel centres.
  const float high = static_cast<float>(0.5 + 0.5 * std::sqrt(0.5)), low = 1 - high;
  const auto near = [](float x) { return testing::FloatNear(x, 1e-7F); };
  EXPECT_THAT(intensity_profile({Axis::columns, 4, 0, 0}, 5),
              ElementsAre(near(high), near(low), near(low), near(high), near(high)));
  EXPECT_THAT(intensity_profile({Axis::columns, 4, kPi / 2, 0}, 4),
              ElementsAre(near(low), near(low), near(high), near(high)));
  EXPECT_NEAR(ideal_intensity({Axis::columns, 64, kPi / 2, 0}, 15.5), 0, 1e-15);  // phase pi/2 + shift pi/2
}

TEST(Patterns, QuantisedProfileHasTheLevelsOfItsBits) {
  EXPECT_THAT(intensity_profile({Axis::columns, 4, 0, 1}, 4), ElementsAre(1, 0, 0, 1));
  for (const int bits : {1, 2, 4, 8, 10}) {
    const double levels = (1 << bits) - 1;
    const auto exact = intensity_profile({Axis::columns, 37, 0.4, 0}, 500);
    const auto quantised = intensity_profile({Axis::columns, 37, 0.4, bits}, 500);
    for (size_t i = 0; i < exact.size(); ++i) {
      EXPECT_NEAR(quantised[i], exact[i], 0.5 / levels + 1e-6);
      EXPECT_NEAR(quantised[i] * levels, std::round(quantised[i] * levels), 1e-3);
    }
  }
}

TEST(Patterns, ImageVariesAlongItsAxisOnly) {
  const cv::Mat1b columns = pattern_image({Axis::columns, 4, 0, 1}, 8, 6);
  const cv::Mat1b rows = pattern_image({Axis::rows, 4, 0, 1}, 6, 8);
  ASSERT_EQ(columns.size(), cv::Size(8, 6));
  for (int i = 0; i < 8; ++i) {
    const uchar expected = i % 4 == 0 || i % 4 == 3 ? 255 : 0;
    for (int j = 0; j < 6; ++j) {
      EXPECT_EQ(columns(j, i), expected);
      EXPECT_EQ(rows(i, j), expected);
    }
  }
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
  // A whole turn is the same image: two equations for three unknowns.
  EXPECT_THAT(with_shifts({0, kPi, 2 * kPi}), HasSubstr("fewer than three distinct phase shifts"));
}

}  // namespace
}  // namespace fringeslam
