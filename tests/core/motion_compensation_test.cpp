// SPDX-License-Identifier: Apache-2.0
// Fringes that drift during the sequence, generated directly from their equation, and surfaces that move relative to
// the camera.
#include "core/decode/motion_compensation.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "tests/support/fringes.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::small_rig;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi, kPeriod = 16;

// Images of one period with the given shifts, for a ramp of coordinates that moves at `rate` px/s.
struct Drift {
  FringeStack stack;
  cv::Mat1d truth = support::ramp(100, 900, 2000);  // at stack.timestamp_s
  double rate_px_s = 0;
  DecodedStack decoded;

  // `times` are relative to the timestamp.
  Drift(const std::vector<double>& shifts, const std::vector<double>& times, double rate) : rate_px_s(rate) {
    PatternSequence sequence{1024, 768};
    std::vector<cv::Mat> images;
    for (size_t k = 0; k < shifts.size(); ++k) {
      sequence.patterns.push_back({Axis::columns, kPeriod, shifts[k], 0});
      const PatternSequence one{1024, 768, {sequence.patterns.back()}};
      cv::Mat1d moved = truth.clone();
      moved += rate * times[k];
      images.push_back(support::fringe_stack(moved, one, {}, CV_32FC1).images[0]);
    }
    stack = support::stack_of(sequence, images);
    stack.timestamp_s = 1024;
    for (size_t k = 0; k < times.size(); ++k) stack.exposure_time_s[k] = stack.timestamp_s + times[k];
    CoordinatePrior expected{cv::Mat1f(truth.size()), cv::Mat1f(truth.size(), 0.0f), cv::Mat1f(truth.size(), 0.5f)};
    truth.convertTo(expected.coordinate_px, CV_32F);
    RigModel rig = small_rig(false);
    options.unwrapping = Unwrapping::predicted;
    options.max_order_failure = 1;
    options.max_order_residual_sigma = 1e6;
    decoded = decode(stack, rig, options, {Axis::columns, &expected});
  }
  void compensate() {
    compensate_motion(decoded, stack, options, cv::Mat1f(truth.size(), static_cast<float>(rate_px_s)));
  }
  // Maximum coordinate error modulo one period, rad.
  double worst(const std::function<double(double)>& offset = {}) const {
    double worst = 0;
    for (int i = 0; i < truth.cols; ++i) {
      const double turn = 2 * kPi / kPeriod, phase = absolute_phase(truth(i), kPeriod);
      const double error = turn * (decoded.coordinate_px(i) - truth(i)) - (offset ? offset(phase) : 0);
      worst = std::max(worst, std::abs(std::remainder(error, 2 * kPi)));  // ignores NaN
    }
    return worst;
  }

 private:
  DecodeOptions options;
};

struct Steps {
  std::vector<double> shifts, times_s;
};
std::vector<double> equally_spaced(int count, double first) {
  std::vector<double> shifts;
  for (int k = 0; k < count; ++k) shifts.push_back(first + 2 * kPi * k / count);
  return shifts;
}

class DriftingFringes : public testing::TestWithParam<Steps> {};
INSTANTIATE_TEST_SUITE_P(
    Steps, DriftingFringes,
    testing::Values(Steps{equally_spaced(3, -2 * kPi / 3), {-1, 0, 1}}, Steps{equally_spaced(3, 0.4), {4, 5, 6}},
                    Steps{equally_spaced(4, 0), {-1.5, -0.5, 0.5, 1.5}}, Steps{equally_spaced(4, 1), {3, 0, 2, 1}},
                    Steps{equally_spaced(7, -0.2), {-3, -2, -1, 0, 1, 2, 3}}, Steps{{0, 1.1, 2.5, 4.4}, {0, 1, 2, 3}}));

TEST_P(DriftingFringes, AreUndoneWhateverTheDrift) {
  for (const double rate : {0.1, -0.6, 1.2}) {  // px per step, with a period of 16 px
    Drift drift(GetParam().shifts, GetParam().times_s, rate);
    EXPECT_GT(drift.worst(), 0.005);
    drift.compensate();
    EXPECT_LT(drift.worst(), 1e-4) << rate;  // a coordinate of 900 px is rounded to 2e-5 rad
    for (int i = 0; i < drift.truth.cols; ++i) {
      const double again = (drift.decoded.wrapped_phase(i) / (2 * kPi) + drift.decoded.fringe_order(i)) * kPeriod - 0.5;
      EXPECT_NEAR(again, drift.decoded.coordinate_px(i), 1e-3);
    }
  }
}

// The remainder after subtracting (2/N) sum sin^2(phi + delta_k) eps_k is of second order.
TEST(DriftOfFringes, AreOffByTheFirstOrderFormula) {
  for (const int count : {3, 4, 5, 8}) {
    const std::vector<double> shifts = equally_spaced(count, 0.7);
    std::vector<double> times;
    for (int k = 0; k < count; ++k) times.push_back(k * k * 0.3 - 1);
    const auto left = [&](double rate) {
      return Drift(shifts, times, rate).worst([&](double phase) {
        double sum = 0;
        for (int k = 0; k < count; ++k) {
          const auto i = static_cast<size_t>(k);
          sum += 2.0 / count * std::pow(std::sin(phase + shifts[i]), 2) * 2 * kPi * rate * times[i] / kPeriod;
        }
        return sum;
      });
    };
    EXPECT_NEAR(left(0.2) / left(0.1), 4, 0.4) << count;
  }
}

TEST(DriftOfFringes, OfThreeStepsAreOffByASineOfTwicePhi) {
  const double step = 0.02;
  const Drift drift(equally_spaced(3, -2 * kPi / 3), {-1, 0, 1}, step * kPeriod / (2 * kPi));
  const double left = drift.worst([&](double phase) { return -step / std::sqrt(3.0) * std::sin(2 * phase); });
  EXPECT_LT(left, step * step);
  EXPECT_NEAR(drift.worst(), step / std::sqrt(3.0), step * step);
}

TEST(MotionCompensation, NoRateChangesNoBit) {
  Drift drift(equally_spaced(3, 0), {4, 5, 6}, 0.3);
  const DecodedStack before = drift.decoded;
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
  };
  for (const float rate : {0.0f, std::numeric_limits<float>::quiet_NaN()}) {
    DecodedStack after = before;
    for (cv::Mat1f* image : {&after.coordinate_px, &after.wrapped_phase}) *image = image->clone();
    after.fringe_order = before.fringe_order.clone();
    compensate_motion(after, drift.stack, {}, cv::Mat1f(drift.truth.size(), rate));
    EXPECT_TRUE(same(after.coordinate_px, before.coordinate_px));
    EXPECT_TRUE(same(after.wrapped_phase, before.wrapped_phase));
    EXPECT_TRUE(same(after.fringe_order, before.fringe_order));
  }
  EXPECT_THAT(error_of([&] { compensate_motion(drift.decoded, drift.stack, {}, cv::Mat1f(3, 3)); }),
              HasSubstr("differ in size"));
  drift.stack.exposure_time_s.pop_back();
  EXPECT_THAT(error_of([&] { compensate_motion(drift.decoded, drift.stack, {}, cv::Mat1f()); }),
              HasSubstr("3 exposures and 2 exposure times"));
}

// Compared with finite differences of the coordinates shortly before and after.
TEST(CoordinateRate, IsWhatTheMovingCameraSees) {
  const CameraTwist twist{{0.2, -0.3, 0.4}, {0.1, -0.05, 0.08}};
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.3, -0.8).normalized();
  const auto surfaces = {support::plane(normal, normal.z()), support::bumps(1, 0.01, 0.1)};
  const double dt = 1e-3;
  for (const auto& surface : surfaces) {
    const RigModel rig = small_rig(true);
    const auto columns = [&](double t) {
      const Pose pose{rotation_exp(t * twist.angular_rad_s), t * twist.velocity_m_s};
      return support::seen_columns(surface, rig, pose, 0).coordinate_px;
    };
    const cv::Mat1f before = columns(-dt), after = columns(dt);
    const Frame frame = support::observe(surface, rig, {}, 1e-4);
    const cv::Mat1f rate = coordinate_rate(frame, rig, pixel_rays(rig.camera), twist);
    double squares = 0;
    for (int row = 0; row < rate.rows; row += 5) {
      for (int col = 0; col < rate.cols; col += 5) {
        const double expected = (after(row, col) - before(row, col)) / (2 * dt);
        EXPECT_NEAR(rate(row, col), expected, 0.5 + 0.01 * std::abs(expected)) << row << ", " << col;
        squares += expected * expected;
      }
    }
    EXPECT_GT(std::sqrt(squares / (25.0 * 27)), 20);
  }
}

}  // namespace
}  // namespace fringeslam
