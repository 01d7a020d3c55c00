// SPDX-License-Identifier: Apache-2.0
#include "core/decode/decode.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/patterns/waveform.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::fringe_stack;
using support::FringeLight;
using support::ramp;
using support::Random;
using support::stack_of;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr int kWidth = 1024;

PatternSequence columns(const std::vector<double>& periods, int steps = 3) {
  return phase_shift_sequence(kWidth, 768, periods, steps, Axis::columns, 0);
}

DecodedStack decode(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options,
                    Axis axis = Axis::columns) {
  RigModel rig;
  rig.sensor = sensor;
  return fringeslam::decode(stack, rig, options, {axis});
}

SensorModel sensor_of(int bits) {
  SensorModel sensor;
  sensor.bits = bits;
  sensor.gain_dn_per_electron = sensor.max_dn() / 40000;
  return sensor;
}

// Only quantisation noise, with a variance of 1/12.
SensorModel silent_sensor() {
  SensorModel sensor;
  sensor.gain_dn_per_electron = 0;
  return sensor;
}

double share_valid(const cv::Mat1f& image) {
  return static_cast<double>(std::count_if(image.begin(), image.end(), [](float x) { return !std::isnan(x); })) /
         static_cast<double>(image.total());
}

TEST(Decode, ThreeStepsAreThePapersClosedForm) {
  Random random(1);
  std::vector<cv::Mat> images;
  for (int k = 0; k < 3; ++k) {
    cv::Mat1f image(20, 30);
    for (float& grey : image) grey = static_cast<float>(random.uniform(20, 200));
    images.push_back(image);
  }
  const auto decoded =
      decode(stack_of(columns({kWidth}), images), silent_sensor(), {.min_modulation_dn = 0, .min_data_modulation = 0});
  for (int row = 0; row < 20; ++row) {
    for (int col = 0; col < 30; ++col) {
      const auto grey = [&](int k) { return static_cast<double>(images[k].at<float>(row, col)); };
      const double sine = std::sqrt(3.0) * (grey(0) - grey(2)), cosine = 2 * grey(1) - grey(0) - grey(2);
      EXPECT_NEAR(decoded.mean(row, col), (grey(0) + grey(1) + grey(2)) / 3, 1e-4);
      EXPECT_NEAR(decoded.modulation(row, col), std::hypot(sine, cosine) / 3, 1e-4);
      if (std::hypot(sine, cosine) < 30) continue;  // modulation too low to be valid
      // The single period leaves no gap: near phase 0 the first and last columns cannot be distinguished.
      if (std::abs(std::atan2(sine, cosine)) < 0.1) continue;
      EXPECT_NEAR(decoded.wrapped_phase(row, col), std::atan2(sine, cosine), 1e-6);
    }
  }
}

// Steps x (bits of the grey values, image type).
class DecodeFormats : public testing::TestWithParam<std::tuple<int, std::pair<int, int>>> {
 protected:
  int steps() const { return std::get<0>(GetParam()); }
  int bits() const { return std::get<1>(GetParam()).first; }
  int type() const { return std::get<1>(GetParam()).second; }
};
INSTANTIATE_TEST_SUITE_P(StepsAndDepths, DecodeFormats,
                         testing::Combine(testing::Values(3, 4, 5, 7),
                                          testing::Values(std::pair(8, CV_8UC1), std::pair(12, CV_16UC1),
                                                          std::pair(12, CV_32FC1))));

TEST_P(DecodeFormats, RecoversTheCoordinateToWithinRounding) {
  const SensorModel sensor = sensor_of(bits());
  const FringeLight light{0.45 * sensor.max_dn(), 0.4 * sensor.max_dn()};
  // Not at the borders, where rounding may move a phase across the end of the coarsest period.
  const cv::Mat1d truth = ramp(3, kWidth - 4, 3001);
  const auto sequence = columns({1040, 131, 16.5}, steps());
  const auto decoded = decode(fringe_stack(truth, sequence, light, type()), sensor, {});
  // An error of half a grey value in every sample changes the phase by 2/N sum |sin| 0.5 / I'' <= 1 / I''.
  const double limit = type() == CV_32FC1 ? 1e-4 : 16.5 / (2 * kPi) / light.modulation_dn + 1e-4;
  for (int i = 0; i < truth.cols; ++i) {
    ASSERT_NEAR(decoded.coordinate_px(0, i), truth(0, i), limit) << i;
    const double phase = absolute_phase(truth(0, i), 16.5);
    EXPECT_NEAR(decoded.wrapped_phase(0, i) + 2 * kPi * decoded.fringe_order(0, i), phase, 2 * kPi * limit / 16.5);
    EXPECT_NEAR(decoded.mean(0, i), light.mean_dn, 0.51);
    EXPECT_NEAR(decoded.modulation(0, i), light.modulation_dn, 1.01);
    EXPECT_GT(decoded.confidence(0, i), 1 - 1e-4);
  }
}

TEST_P(DecodeFormats, PredictedSigmaIsTheEmpiricalScatter) {
  const SensorModel sensor = sensor_of(bits());
  const FringeLight light{0.3 * sensor.max_dn(), 0.2 * sensor.max_dn()};
  const auto sequence = columns({1040, 131, 16.5}, steps());
  cv::Mat1d truth(100, 300);
  Random random(2);
  for (double& u : truth) u = random.uniform(50, kWidth - 50);
  const auto decoded = decode(fringe_stack(truth, sequence, light, type(), sensor, &random), sensor, {});
  double sum = 0, squares = 0;
  int count = 0;
  for (int i = 0; i < static_cast<int>(truth.total()); ++i) {
    const float u = decoded.coordinate_px(i / 300, i % 300);
    if (std::isnan(u)) continue;
    const double scaled = (u - truth(i / 300, i % 300)) / decoded.sigma_px(i / 300, i % 300);
    ASSERT_LT(std::abs(scaled), 6) << "a wrong fringe order";
    sum += scaled, squares += scaled * scaled, ++count;
  }
  EXPECT_GT(count, 0.998 * static_cast<double>(truth.total()));
  EXPECT_NEAR(std::sqrt(squares / count), 1, 0.05);
  EXPECT_NEAR(sum / count, 0, 5 / std::sqrt(count));
}

TEST(Decode, SigmaOfEqualNoiseIsRootTwoOverN) {
  for (const int steps : {3, 4, 5, 7, 12}) {
    const auto sequence = columns({kWidth}, steps);
    const auto decoded = decode(fringe_stack(ramp(10, 1013, 50), sequence, {100, 50}, CV_32FC1), silent_sensor(), {});
    const double sigma_phase = std::sqrt(2.0 / steps) * std::sqrt(1.0 / 12) / 50;
    for (const float sigma : decoded.sigma_px) EXPECT_NEAR(sigma, sigma_phase * kWidth / (2 * kPi), 1e-4);
  }
}

TEST(Decode, SigmaOfThreeStepsVariesWithThePhaseUnderShotNoise) {
  // Sigma is larger where the bright samples dominate; six phases are tested separately.
  const SensorModel sensor = sensor_of(8);
  const auto sequence = columns({kWidth});
  Random random(5);
  for (int sixth = 0; sixth < 6; ++sixth) {
    const double truth = (sixth + 0.5) / 6 * kWidth - 0.5;
    const auto stack = fringe_stack(cv::Mat1d(100, 200, truth), sequence, {120, 110}, CV_32FC1, sensor, &random);
    const auto decoded = decode(stack, sensor, {});
    double squares = 0;
    for (const float u : decoded.coordinate_px) squares += std::pow(u - truth, 2) / 20000;
    double predicted = 0;
    for (const float sigma : decoded.sigma_px) predicted += sigma * sigma / 20000.0;
    EXPECT_NEAR(std::sqrt(squares / predicted), 1, 0.03) << "phase " << 30 + 60 * sixth << " degrees";
  }
}

TEST(Decode, ReadsTheShiftsOfThePatternsNotTheirOrder) {
  PatternSequence sequence{kWidth, 768, {}};
  for (const auto& [period, shift] : std::vector<std::pair<double, double>>{
           {16, 3.0}, {1024, 0.2}, {128, 1.0}, {16, 0.4}, {128, 5.0}, {1024, 1.9}, {16, 1.1}, {128, 2.2}, {1024, 4.4}})
    sequence.patterns.push_back({Axis::columns, period, shift, 0});
  const cv::Mat1d truth = ramp(5, 1018, 500);
  const auto decoded = decode(fringe_stack(truth, sequence, {}, CV_32FC1), silent_sensor(), {});
  for (int i = 0; i < truth.cols; ++i) ASSERT_NEAR(decoded.coordinate_px(0, i), truth(0, i), 1e-3);
}

TEST(Decode, RowsOfTheProjector) {
  const auto sequence = phase_shift_sequence(kWidth, 768, {768, 96, 12}, 4, Axis::rows, 0);
  const cv::Mat1d truth = ramp(2, 765, 500);
  const auto decoded = decode(fringe_stack(truth, sequence, {}, CV_32FC1), silent_sensor(), {}, Axis::rows);
  for (int i = 0; i < truth.cols; ++i) ASSERT_NEAR(decoded.coordinate_px(0, i), truth(0, i), 1e-3);
  EXPECT_THAT(error_of([&] { decode(fringe_stack(truth, sequence, {}, CV_32FC1), silent_sensor(), {}); }),
              HasSubstr("the sequence has no fringes along columns"));
}

struct PhaseErrors {
  double largest_rad = 0, rms_rad = 0, sigma_rad = 0;  // sigma: root mean square of the predicted ones
};

// Errors of three steps from a projector of gamma 2.2, of which image k shows the surface `drift_turns[k]` periods further on.
PhaseErrors errors_after_drift(const std::vector<double>& drift_turns, bool corrected) {
  constexpr double kGamma = 2.2, kPeriod_px = 1040;
  constexpr int kRows = 16;  // the drift is sampled
  RigModel rig;
  rig.sensor = silent_sensor();
  if (corrected) rig.phase_correction = phase_correction_of(gamma_table(kGamma), 3);
  const cv::Mat1d truth = ramp(200, kWidth - 200, 2001);  // far from the borders, as the phase is off by up to 80 px
  const PatternSequence sequence = columns({kPeriod_px});
  AlignedStack aligned;
  std::vector<cv::Mat> images;
  for (size_t k = 0; k < sequence.patterns.size(); ++k) {
    cv::Mat1f image(truth.size());
    for (int i = 0; i < truth.cols; ++i)
      image(0, i) = static_cast<float>(
          10 +
          200 * std::pow(ideal_intensity(sequence.patterns[k], truth(0, i) + drift_turns[k] * kPeriod_px), kGamma));
    aligned.images.push_back(cv::repeat(image, kRows, 1));
    aligned.drift_px.emplace_back(aligned.images.back().size(), static_cast<float>(drift_turns[k] * kPeriod_px));
    images.push_back(aligned.images.back());
  }
  DecodeContext context{Axis::columns};
  context.aligned = &aligned;
  const DecodedStack decoded = fringeslam::decode(stack_of(sequence, images), rig, {}, context);
  PhaseErrors errors;
  for (int i = 0; i < truth.cols; ++i) {
    const double error = 2 * kPi / kPeriod_px * (decoded.coordinate_px(0, i) - truth(0, i)),
                 sigma = 2 * kPi / kPeriod_px * decoded.sigma_px(0, i);
    EXPECT_FALSE(std::isnan(error)) << i;
    errors.largest_rad = std::max(errors.largest_rad, std::abs(error));
    errors.rms_rad += error * error / truth.cols;
    errors.sigma_rad += sigma * sigma / truth.cols;
  }
  errors.rms_rad = std::sqrt(errors.rms_rad);
  errors.sigma_rad = std::sqrt(errors.sigma_rad);
  return errors;
}

// In motion, the shifts relative to the surface decide, not those of the patterns.
TEST(Decode, CorrectionOfAProjectorFollowsTheDrift) {
  ASSERT_GT(errors_after_drift({0, 0, 0}, false).largest_rad, 0.25);
  for (const std::vector<double>& drift : {std::vector<double>{0, 0, 0},
                                           {0.17, 0.17, 0.17},
                                           {0, 1.0 / 3, 2.0 / 3},
                                           {-0.4, -0.4 + 1.0 / 3, -0.4 + 2.0 / 3}})
    EXPECT_LT(errors_after_drift(drift, true).largest_rad, 0.01) << drift[0] << ' ' << drift[1];
  // Shifts that are no longer equally spaced leave an error, which sigma contains.
  for (const double step : {-0.06, -0.03, 0.03, 0.06}) {
    const PhaseErrors errors = errors_after_drift({-step, 0, step}, true);
    const double uncorrected_rad = errors_after_drift({-step, 0, step}, false).rms_rad;
    EXPECT_LT(errors.rms_rad, std::abs(step) < 0.05 ? 0.8 * uncorrected_rad : 1.01 * uncorrected_rad) << step;
    EXPECT_LT(errors.rms_rad, 1.1 * errors.sigma_rad) << step;
  }
}

// At the borders of moved images the drift is unknown.
TEST(Decode, CorrectionOfAProjectorLeavesUnknownPhasesInvalid) {
  RigModel rig;
  rig.sensor = silent_sensor();
  rig.phase_correction = phase_correction_of(gamma_table(2.2), 3);
  const cv::Mat1d truth = ramp(200, 800, 100);
  const PatternSequence sequence = columns({1040});
  AlignedStack aligned;
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1f image(truth.size()), drift(truth.size(), 0.f);
    for (int i = 0; i < truth.cols; ++i)
      image(0, i) = static_cast<float>(10 + 200 * std::pow(ideal_intensity(pattern, truth(0, i)), 2.2));
    if (!images.empty()) drift(0, 0) = drift(0, 50) = std::numeric_limits<float>::quiet_NaN();
    aligned.images.push_back(image);
    aligned.drift_px.push_back(drift);
    images.push_back(image);
  }
  DecodeContext context{Axis::columns};
  context.aligned = &aligned;
  const DecodedStack decoded = fringeslam::decode(stack_of(sequence, images), rig, {}, context);
  for (int i = 0; i < truth.cols; ++i) {
    if (i == 0 || i == 50)
      EXPECT_TRUE(std::isnan(decoded.coordinate_px(0, i)));
    else
      EXPECT_NEAR(decoded.coordinate_px(0, i), truth(0, i), 2);
  }
}

TEST(Decode, NoiseDoesNotLoseTheBordersOfTheProjector) {
  // The coarsest period is 16 px longer than the projector width, so a phase just below 0 can only be column 0.
  const SensorModel sensor = sensor_of(8);
  const auto sequence = columns({1040, 131, 16.5});
  for (const double border : {0.0, kWidth - 1.0}) {
    const cv::Mat1d truth(60, 60, border);
    Random random(3);
    const auto stack = fringe_stack(truth, sequence, {80, 50}, CV_8UC1, sensor, &random);
    EXPECT_GT(share_valid(decode(stack, sensor, {}).coordinate_px), 0.99) << "column " << border;
  }
}

TEST(Decode, NoiseDoesNotCarryOneBorderToTheOther) {
  // A coarsest period equal to the projector width leaves no gap; ambiguous pixels must be invalid.
  const SensorModel sensor = sensor_of(8);
  for (const std::vector<double>& periods : {std::vector<double>{1024, 128, 16}, {1040, 131, 16.5}}) {
    const auto sequence = columns(periods);
    for (const double truth : {-0.4, 0.0, 1.0, kWidth - 2.0, kWidth - 1.0, kWidth - 0.6}) {
      Random random(6);
      const auto stack = fringe_stack(cv::Mat1d(60, 60, truth), sequence, {80, 50}, CV_8UC1, sensor, &random);
      const auto decoded = decode(stack, sensor, {});
      const auto astray = std::count_if(decoded.coordinate_px.begin(), decoded.coordinate_px.end(),
                                        [&](float u) { return std::abs(u - truth) > 1; });
      EXPECT_EQ(astray, 0) << "column " << truth << ", period " << periods[0];
    }
  }
}

// Decodes one noise-free pixel and returns whether it is valid.
bool accepts(const FringeLight& light, const DecodeOptions& options) {
  const auto sequence = columns({kWidth});
  // Column 511.5 has phase pi, so its largest samples are those with shifts of +-120 degrees.
  const auto decoded =
      decode(fringe_stack(cv::Mat1d(1, 1, 511.5), sequence, light, CV_32FC1), silent_sensor(), options);
  EXPECT_FALSE(std::isnan(decoded.mean(0, 0)));
  EXPECT_FALSE(std::isnan(decoded.modulation(0, 0)));
  const bool valid = !std::isnan(decoded.coordinate_px(0, 0));
  EXPECT_EQ(valid, !std::isnan(decoded.sigma_px(0, 0)));
  EXPECT_EQ(valid, !std::isnan(decoded.wrapped_phase(0, 0)));
  EXPECT_EQ(valid, decoded.fringe_order(0, 0) >= 0);
  return valid;
}

TEST(Decode, ClippedSamplesHaveNoPhase) {
  // Largest sample: 160 + 160 cos(60 degrees) = 240 of 255 grey values.
  EXPECT_TRUE(accepts({160, 160}, {.saturation = 240.5 / 255}));
  EXPECT_FALSE(accepts({160, 160}, {.saturation = 239.5 / 255}));
}

// A camera whose full well is reached below full scale, as `calibrate noise` finds it.
TEST(Decode, SamplesClippedByTheFullWellHaveNoPhase) {
  constexpr double kClip_dn = 180;
  SensorModel sensor = sensor_of(8);
  const auto sequence = columns({kWidth, 131, 16.5});
  cv::Mat1d truth(1, 200);
  for (int col = 0; col < truth.cols; ++col) truth(0, col) = 100 + 0.37 * col;
  FringeStack stack = fringe_stack(truth, sequence, {110, 90}, CV_8UC1);
  const DecodedStack unclipped = decode(stack, sensor, {});
  for (cv::Mat& image : stack.images) cv::min(image, kClip_dn, image);
  sensor.full_well_electrons = (kClip_dn - sensor.offset_dn) / sensor.gain_dn_per_electron;
  const DecodedStack decoded = decode(stack, sensor, {});
  int clipped_pixels = 0;
  for (int col = 0; col < truth.cols; ++col) {
    EXPECT_FALSE(std::isnan(unclipped.coordinate_px(0, col)));
    bool clipped = false;
    for (const cv::Mat& image : stack.images) clipped |= image.at<uchar>(0, col) >= 0.98 * kClip_dn;
    clipped_pixels += clipped;
    EXPECT_EQ(std::isnan(decoded.coordinate_px(0, col)), clipped) << col;
  }
  EXPECT_GT(clipped_pixels, 50);
}

TEST(Decode, FaintFringesHaveNoPhase) {
  EXPECT_TRUE(accepts({40, 5.01}, {.min_modulation_dn = 5}));
  EXPECT_FALSE(accepts({40, 4.99}, {.min_modulation_dn = 5}));
  EXPECT_TRUE(accepts({100, 10.1}, {.min_data_modulation = 0.1}));
  EXPECT_FALSE(accepts({100, 9.9}, {.min_data_modulation = 0.1}));
  // sqrt(2/3) sqrt(1/12) / 10 = 0.02357 rad
  EXPECT_TRUE(accepts({100, 10}, {.max_phase_sigma_rad = 0.0237}));
  EXPECT_FALSE(accepts({100, 10}, {.max_phase_sigma_rad = 0.0235}));
}

TEST(Decode, TwoSurfacesInOnePixelAreRejectedByTheirResidual) {
  // Half of the light comes from u, half from u + 96. The sum of two sinusoids has the phase of their mean, shifted by
  // pi where cos(half their difference) < 0: at period 1024 it is cos(0.29) > 0, at 128 cos(2.36) < 0.
  const auto sequence = columns({1024, 128, 16});
  const cv::Mat1d first = ramp(10, 900, 300), second = ramp(10 + 96, 900 + 96, 300);
  FringeStack mixed = fringe_stack(first, sequence, {}, CV_32FC1);
  const FringeStack other = fringe_stack(second, sequence, {}, CV_32FC1);
  for (size_t k = 0; k < mixed.images.size(); ++k) mixed.images[k] = 0.5 * mixed.images[k] + 0.5 * other.images[k];
  EXPECT_EQ(share_valid(decode(mixed, sensor_of(8), {}).coordinate_px), 0);
  const DecodeOptions open{.max_order_failure = 1, .max_order_residual_sigma = 1e6};
  EXPECT_GT(share_valid(decode(mixed, sensor_of(8), open).coordinate_px), 0.99);
}

TEST(Decode, ConfidenceIsTheShareOfRightOrders) {
  // With a period ratio of 40 and noise of 0.03 rad, the sigma of 40 Phi_low - phi_high is about 1.3 rad, so about one
  // order in a hundred is wrong.
  const SensorModel sensor = sensor_of(8);
  const auto sequence = columns({1024, 25.6});
  cv::Mat1d truth(200, 200);
  Random random(4);
  for (double& u : truth) u = random.uniform(100, kWidth - 100);
  const auto stack = fringe_stack(truth, sequence, {60, 17.5}, CV_32FC1, sensor, &random);
  const DecodeOptions open{.max_order_failure = 1, .max_order_residual_sigma = 1e6};
  const auto decoded = decode(stack, sensor, open);
  double wrong = 0, predicted = 0, count = 0;
  for (int row = 0; row < truth.rows; ++row) {
    for (int col = 0; col < truth.cols; ++col) {
      if (std::isnan(decoded.coordinate_px(row, col))) continue;
      wrong += std::abs(decoded.coordinate_px(row, col) - truth(row, col)) > 12.8;
      predicted += 1 - decoded.confidence(row, col);
      ++count;
    }
  }
  ASSERT_GT(wrong, 200);
  EXPECT_GT(count, 0.99 * static_cast<double>(truth.total()));
  EXPECT_NEAR(wrong / predicted, 1, 0.05 + 3 / std::sqrt(wrong));
}

TEST(Decode, InconsistentStacksAreErrors) {
  const auto sequence = columns({1024, 128});
  const auto error = [&](const FringeStack& stack) { return error_of([&] { decode(stack, SensorModel{}, {}); }); };
  const FringeStack good = fringe_stack(ramp(0, 100, 10), sequence, {}, CV_8UC1);
  EXPECT_NO_THROW(decode(good, SensorModel{}, {}));
  FringeStack short_by_one = good;
  short_by_one.images.pop_back();
  EXPECT_THAT(error(short_by_one), HasSubstr("has 5 images, 6 patterns, 6 exposures and 6 exposure times"));
  FringeStack without_times = good;
  without_times.exposure_time_s.clear();
  EXPECT_THAT(error(without_times), HasSubstr("has 6 images, 6 patterns, 6 exposures and 0 exposure times"));
  FringeStack one_duration = good;
  one_duration.exposure_s.resize(1);
  EXPECT_THAT(error(one_duration), HasSubstr("has 6 images, 6 patterns, 1 exposures and 6 exposure times"));
  FringeStack other_patterns = good;
  other_patterns.patterns = columns({1024});
  EXPECT_THAT(error(other_patterns), HasSubstr("has 6 images, 3 patterns, 6 exposures and 6 exposure times"));
  FringeStack mixed_sizes = good;
  mixed_sizes.images[3] = cv::Mat1b(1, 9, uchar{7});
  EXPECT_THAT(error(mixed_sizes), HasSubstr("differ in size or type"));
  FringeStack colour = good;
  for (cv::Mat& image : colour.images) image = cv::Mat(1, 10, CV_8UC3, cv::Scalar::all(7));
  EXPECT_THAT(error(colour), HasSubstr("must be grey"));
}

TEST(ExposureTimes, AreCentredOnTheTimestamp) {
  Timing timing;
  timing.camera_rate_hz = 50;
  EXPECT_THAT(exposure_times_s(0, 3, timing), testing::ElementsAre(-0.02, 0, 0.02));
  EXPECT_THAT(exposure_times_s(8, 2, timing), testing::ElementsAre(7.99, 8.01));
}

TEST(Decode, NoPeriodThatCoversTheProjectorIsAnError) {
  const auto sequence = columns({1000, 128});
  EXPECT_THAT(error_of([&] { decode(fringe_stack(ramp(0, 100, 10), sequence, {}, CV_8UC1), SensorModel{}, {}); }),
              HasSubstr("no fringe period covers the projector's 1024 px"));
}

}  // namespace
}  // namespace fringeslam
