// SPDX-License-Identifier: Apache-2.0
#include "core/decode/rolling_phase.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>

#include "bench/accuracy/fringe_ripple.h"
#include "bench/accuracy/moving_hand.h"
#include "core/decode/decode.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using bench::binomial_phase;
using bench::four_step_phase;
using bench::tile_ripple;
using support::error_of;
using support::Random;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr double kImageInterval_s = 1.0 / 90;

// A scene whose phase at time 0 is a plane and drifts by eps per image; times are counted in images.
struct Drifting {
  int steps = 4;
  std::function<double(int row, int col)> drift_rad = [](int, int) { return 0.0; };
  double drift_change_rad = 0;
  double harmonic = 0;  // of order steps - 1
  double mean_dn = 110, mean_drift_dn = 0, modulation_dn = 70;
  cv::Size size{160, 80};
  std::function<double(int row, int col)> relief_rad = [](int, int) { return 0.0; };

  double phase(int row, int col, double image) const {
    return 0.15 * col + 0.03 * row + relief_rad(row, col) + drift_rad(row, col) * image +
           0.5 * drift_change_rad * image * image;
  }
  double grey(int row, int col, double image, double shift_rad) const {
    const double psi = phase(row, col, image) + shift_rad;
    return mean_dn + mean_drift_dn * image + modulation_dn * (std::cos(psi) + harmonic * std::cos((steps - 1) * psi));
  }
};

double shift_of(int image, int steps) { return 2 * kPi * (image % steps) / steps; }

// Images 0, 1, … at the times of these numbers; image k has the shift 2 pi k / steps.
FringeStack recording(const Drifting& scene, int images, const SensorModel& sensor = {}, Random* noise = nullptr) {
  FringeStack out;
  out.patterns = {1280, 800};
  for (int k = 0; k < images; ++k) {
    Pattern pattern;
    pattern.period_px = 45;
    pattern.shift_rad = shift_of(k, scene.steps);
    out.patterns.patterns.push_back(pattern);
    cv::Mat1f image(scene.size);
    for (int row = 0; row < image.rows; ++row) {
      for (int col = 0; col < image.cols; ++col) {
        const double grey = scene.grey(row, col, k, pattern.shift_rad);
        image(row, col) =
            static_cast<float>(grey + (noise ? std::sqrt(sensor.variance_dn2(grey)) * noise->normal() : 0));
      }
    }
    out.images.push_back(image);
    out.exposure_s.push_back(kImageInterval_s);
    out.exposure_time_s.push_back(100 + k * kImageInterval_s);
  }
  return out;
}

std::vector<cv::Mat1f> grey_images(const FringeStack& stack) { return {stack.images.begin(), stack.images.end()}; }

// Difference from the scene's phase at a time counted in images, H x W; NaN where the phase is.
cv::Mat1d phase_error(const cv::Mat1f& phase, const Drifting& scene, double image) {
  cv::Mat1d error(phase.size());
  for (int row = 0; row < phase.rows; ++row) {
    for (int col = 0; col < phase.cols; ++col)
      error(row, col) = std::remainder(phase(row, col) - scene.phase(row, col, image), 2 * kPi);
  }
  return error;
}

double largest(const cv::Mat1d& error) {
  double out = 0;
  for (const double e : error) out = std::isnan(e) ? INFINITY : std::max(out, std::abs(e));
  return out;
}

double rms_ratio(const cv::Mat1d& error, const cv::Mat1f& sigma, double* known_share = nullptr) {
  double squares = 0;
  int count = 0;
  for (int row = 0; row < error.rows; ++row) {
    for (int col = 0; col < error.cols; ++col) {
      if (std::isnan(error(row, col))) continue;
      squares += std::pow(error(row, col) / static_cast<double>(sigma(row, col)), 2);
      ++count;
    }
  }
  if (known_share) *known_share = static_cast<double>(count) / static_cast<double>(error.total());
  return std::sqrt(squares / count);
}

cv::Mat1b whole(const Drifting& scene) { return {scene.size, uchar{1}}; }

// A camera with little noise; its variance includes 1/12 for quantisation.
SensorModel fine_sensor() {
  SensorModel sensor;
  sensor.gain_dn_per_electron = 0;
  return sensor;
}

TEST(RollingPhase, FourStepsAtRestRippleByHalfTheDrift) {
  constexpr double kDrift = 0.02;
  const Drifting scene{.drift_rad = [](int, int) { return kDrift; }};
  const std::vector<cv::Mat1f> images = grey_images(recording(scene, 4));
  const cv::Mat1d error = phase_error(four_step_phase(images, 0), scene, 0);
  for (int col = 0; col < error.cols; ++col)
    EXPECT_NEAR(error(5, col), 1.5 * kDrift + 0.5 * kDrift * std::cos(2 * scene.phase(5, col, 1.5)), kDrift * kDrift);
}

TEST(RollingPhase, ThreeStepsAtRestRippleByTheDriftOverRootThree) {
  constexpr double kDrift = 0.02;
  const Drifting scene{.steps = 3, .drift_rad = [](int, int) { return kDrift; }};
  FringeStack stack = recording(scene, 3);
  RigModel rig;
  const DecodedStack decoded = decode(stack, rig, {.unwrapping = Unwrapping::spatial, .min_component_px = 1});
  const cv::Mat1d error = phase_error(decoded.wrapped_phase, scene, 1);
  // The law is for the shifts -120, 0, 120 degrees: with those of the recording, the middle image has 120 degrees.
  for (int col = 0; col < error.cols; ++col)
    EXPECT_NEAR(error(5, col), -kDrift / std::sqrt(3.0) * std::sin(2 * (scene.phase(5, col, 1) + 2 * kPi / 3)),
                kDrift * kDrift);
}

TEST(RollingPhase, BinomialWeightsCancelAConstantDriftToSecondOrder) {
  const Drifting scene{.drift_rad = [](int, int) { return 0.2; }};
  const std::vector<cv::Mat1f> images = grey_images(recording(scene, 8));
  EXPECT_GT(largest(phase_error(four_step_phase(images, 2), scene, 3.5)), 0.09);
  EXPECT_LT(largest(phase_error(binomial_phase(images, 0, 4), scene, 3.5)), 0.2 * 0.2 / 8);
}

class RollingPhaseSteps : public testing::TestWithParam<int> {};

TEST_P(RollingPhaseSteps, ConstantDriftLeavesNoError) {
  const int steps = GetParam();
  for (const double drift : {-0.3, 0.05, 0.3}) {
    const Drifting scene{.steps = steps, .drift_rad = [&](int, int) { return drift; }, .mean_drift_dn = 0.7};
    const FringeStack stack = recording(scene, steps + 6);
    const RollingPhase out =
        decode_rolling_window(stack, 3, steps, fine_sensor(), {.harmonic_prior = 0, .iterations = 12});
    const double middle = 3 + 0.5 * (steps - 1);
    EXPECT_NEAR(out.reference_time_s, 100 + middle * kImageInterval_s, 1e-9);
    EXPECT_EQ(out.first_used, 2u);
    EXPECT_EQ(out.used, static_cast<size_t>(steps + 2));
    EXPECT_LT(largest(phase_error(out.wrapped_phase, scene, middle)), 1e-4) << drift;
    for (const float found : out.drift_rad_s) ASSERT_NEAR(found * kImageInterval_s, drift, 1e-4);
    for (const float modulation : out.modulation) ASSERT_NEAR(modulation, scene.modulation_dn, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(Steps, RollingPhaseSteps, testing::Values(3, 4, 5));

TEST(RollingPhase, AcceleratedDriftLeavesNoErrorAtTheReferenceTime) {
  const Drifting scene{.drift_rad = [](int, int) { return -0.2; }, .drift_change_rad = 0.03};
  const RollingPhase out =
      decode_rolling_window(recording(scene, 8), 2, 4, fine_sensor(), {.harmonic_prior = 0, .iterations = 12});
  EXPECT_LT(largest(phase_error(out.wrapped_phase, scene, 3.5)), 1e-4);
}

TEST(RollingPhase, FourImagesAloneDetermineTheirDrift) {
  const Drifting scene{.drift_rad = [](int, int) { return 0.15; }};
  const RollingPhase out = decode_rolling_window(recording(scene, 4), 0, 4, fine_sensor(), {.harmonic_prior = 0});
  EXPECT_LT(largest(phase_error(out.wrapped_phase, scene, 1.5)), 1e-4);
}

// Drift that varies over the image like that of a turning, bending surface.
double bent_drift(int row, int col) { return 0.15 + 0.1 * std::sin(0.02 * col) + 0.001 * row; }

TEST(RollingPhase, SigmaIsTheScatterOfThePhaseWhereTheDriftVaries) {
  const Drifting scene{.drift_rad = bent_drift};
  SensorModel sensor;
  sensor.gain_dn_per_electron = 255 / 10000.0;
  double squares = 0;
  constexpr int kSeeds = 5;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Random random(seed);
    const RollingPhase out = decode_rolling_window(recording(scene, 8, sensor, &random), 2, 4, sensor);
    double known = 0;
    squares += std::pow(rms_ratio(phase_error(out.wrapped_phase, scene, 3.5), out.sigma_rad, &known), 2);
    EXPECT_GT(known, 0.999);
    const cv::Vec2d ripple = tile_ripple(out.wrapped_phase, whole(scene), scene.size, 2).front();
    const cv::Vec2d plain =
        tile_ripple(four_step_phase(grey_images(recording(scene, 8)), 2), whole(scene), scene.size, 2).front();
    EXPECT_GT(cv::norm(plain), 0.05);
    EXPECT_LT(cv::norm(ripple), 0.03 * cv::norm(plain));
  }
  EXPECT_NEAR(std::sqrt(squares / kSeeds), 1, 0.1);
}

TEST(RollingPhase, FineStructureRemains) {
  // Grooves one pixel wide, and a step.
  const auto relief = [](int row, int col) { return (row % 7 == 3 ? 0.3 : 0) + (col > 90 ? 1.1 : 0); };
  const Drifting scene{.drift_rad = [](int, int) { return 0.2; }, .relief_rad = relief};
  const RollingPhase out = decode_rolling_window(recording(scene, 8), 2, 4, fine_sensor(), {.harmonic_prior = 0});
  EXPECT_LT(largest(phase_error(out.wrapped_phase, scene, 3.5)), 1e-3);
}

TEST(RollingPhase, SigmaOfTheDriftCoversItsError) {
  const Drifting scene{.drift_rad = bent_drift};
  SensorModel sensor;
  double squares = 0;
  int count = 0;
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    Random random(seed);
    const RollingPhase out = decode_rolling_window(recording(scene, 8, sensor, &random), 2, 4, sensor);
    for (int row = 0; row < scene.size.height; row += 5) {
      for (int col = 0; col < scene.size.width; col += 5) {
        const double error = out.drift_rad_s(row, col) * kImageInterval_s - bent_drift(row, col);
        squares += std::pow(error / (out.drift_sigma_rad_s(row, col) * kImageInterval_s), 2);
        ++count;
      }
    }
  }
  EXPECT_LT(std::sqrt(squares / count), 2);
}

TEST(RollingPhase, NothingChangesAtRest) {
  const Drifting scene;
  const SensorModel sensor;
  Random random(1);
  const FringeStack stack = recording(scene, 8, sensor, &random);
  const RollingPhase out = decode_rolling_window(stack, 2, 4, sensor, {.harmonic_prior = 0});
  const cv::Mat1f plain = four_step_phase(grey_images(stack), 2);
  double squares = 0;
  for (int row = 0; row < plain.rows; ++row) {
    for (int col = 0; col < plain.cols; ++col)
      squares +=
          std::pow(std::remainder(out.wrapped_phase(row, col) - plain(row, col), 2 * kPi) / out.sigma_rad(row, col), 2);
  }
  // The estimate of A' from six images adds a variance of 0.058 sigma^2 / B^2 to 0.5 sigma^2 / B^2 for equal noise: the
  // difference is 0.32 of the sum's sigma. Shot noise adds a little.
  EXPECT_LT(std::sqrt(squares / static_cast<double>(plain.total())), 0.4);
  EXPECT_LT(rms_ratio(phase_error(out.wrapped_phase, scene, 0), out.sigma_rad), 1.05);
}

TEST(RollingPhase, MotionShowsTheHarmonicThatTheStepsConfuse) {
  constexpr double kDrift = 0.25, kHarmonic = 0.015;
  const Drifting scene{.drift_rad = [](int, int) { return kDrift; }, .harmonic = kHarmonic};
  const SensorModel sensor;
  Random random(1);
  const FringeStack stack = recording(scene, 8, sensor, &random);
  const cv::Mat1b all = whole(scene);
  const cv::Vec2d plain = tile_ripple(four_step_phase(grey_images(stack), 2), all, scene.size, 2).front();
  // The phase of a window that starts with the shift pi has the same ripple; higher orders of the drift add 3 %.
  EXPECT_NEAR(cv::norm(plain), (1 - 3 * kHarmonic) * kDrift / 2, 0.03 * kDrift / 2);
  const RollingPhase out = decode_rolling_window(stack, 2, 4, sensor);
  EXPECT_NEAR(out.harmonic[0], kHarmonic, 4 * out.harmonic_sigma[0]);
  EXPECT_NEAR(out.harmonic[1], 0, 4 * out.harmonic_sigma[1]);
  EXPECT_LT(out.harmonic_sigma[0], 0.002);
  EXPECT_NEAR(rms_ratio(phase_error(out.wrapped_phase, scene, 3.5), out.sigma_rad), 1, 0.1);
  const RollingPhase sinusoidal = decode_rolling_window(stack, 2, 4, sensor, {.harmonic_prior = 0});
  EXPECT_LT(cv::norm(tile_ripple(out.wrapped_phase, all, scene.size, 4).front()),
            0.2 * cv::norm(tile_ripple(sinusoidal.wrapped_phase, all, scene.size, 4).front()));
}

TEST(RollingPhase, PixelsWithoutFringesAreRejected) {
  Drifting scene{.drift_rad = [](int, int) { return 0.2; }, .mean_dn = 20, .modulation_dn = 0};
  SensorModel sensor;
  sensor.dark_noise_electrons = 450;  // 3 DN
  Random random(1);
  FringeStack stack = recording(scene, 8, sensor, &random);
  const RollingPhase dark = decode_rolling_window(stack, 2, 4, sensor);
  EXPECT_LT(static_cast<double>(cv::countNonZero(dark.modulation > 0)),
            1e-3 * static_cast<double>(dark.wrapped_phase.total()));
  // Beside fringes, whose drift reaches into the dark, too.
  scene.modulation_dn = 70, scene.mean_dn = 110;
  const FringeStack lit = recording(scene, 8, sensor, &random);
  const cv::Rect half(0, 0, 80, 80);
  for (size_t k = 0; k < stack.images.size(); ++k) lit.images[k](half).copyTo(stack.images[k](half));
  const RollingPhase both = decode_rolling_window(stack, 2, 4, sensor);
  cv::Mat1b valid;
  cv::compare(both.modulation, 0, valid, cv::CMP_GT);
  EXPECT_GT(cv::countNonZero(valid(half)), 0.99 * half.area());
  EXPECT_LT(cv::countNonZero(valid(cv::Rect(80, 0, 80, 80))), 1e-3 * half.area());
}

TEST(RollingPhase, BadInputIsAnError) {
  const FringeStack good = recording({}, 8);
  const auto error = [&](const FringeStack& stack, size_t first, int steps, const RollingPhaseOptions& options = {}) {
    return error_of([&] { decode_rolling_window(stack, first, steps, {}, options); });
  };
  EXPECT_THAT(error(good, 5, 4), HasSubstr("images 5 to 8 were requested, but the recording has 8 images"));
  EXPECT_THAT(error(good, 0, 2), HasSubstr("2 steps"));
  FringeStack stack = good;
  stack.patterns.patterns[3].period_px = 20;
  EXPECT_THAT(error(stack, 0, 4), HasSubstr("image 3 does not show fringes of the same period"));
  stack = good;
  for (Pattern& pattern : stack.patterns.patterns) pattern.shift_rad = 0;
  EXPECT_THAT(error(stack, 0, 4), HasSubstr("do not determine the phase"));
  stack = good;
  stack.exposure_time_s[3] = stack.exposure_time_s[2];
  EXPECT_THAT(error(stack, 0, 4), HasSubstr("exposure of image 3 is not later"));
  EXPECT_THAT(error(recording({.steps = 3}, 3), 0, 3), HasSubstr("three images do not determine the drift"));
}

// --- a real capture, if available ---

TEST(Captures, RollingPhaseOfAMovingHandHasLessRippleThanBinomialCompensation) {
  const std::optional<bench::HandRipples> found =
      bench::measure_hand_ripples(bench::moving_hand_folder(FRINGESLAM_SOURCE_DIR));
  if (!found) GTEST_SKIP() << "set FRINGESLAM_CAPTURES to the folder that contains moving_hand/";
  EXPECT_GT(found->tiles, 400);
  const bench::HandRipples::Method &plain = found->plain, &binomial = found->binomial, &rolling = found->rolling;
  EXPECT_LE(rolling.second.mean_of_tiles_rad, plain.second.mean_of_tiles_rad / 3);
  EXPECT_LE(rolling.second.each_tile_rad, plain.second.each_tile_rad / 3);
  EXPECT_LE(rolling.second.mean_of_tiles_rad, binomial.second.mean_of_tiles_rad);
  // At rest, too, four steps confuse the third harmonic with the fringe; binomial weights do not reduce its ripple.
  EXPECT_LE(rolling.fourth.mean_of_tiles_rad, binomial.fourth.mean_of_tiles_rad / 2);
}

}  // namespace
}  // namespace fringeslam
