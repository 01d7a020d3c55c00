// SPDX-License-Identifier: Apache-2.0
#include "core/decode/decode.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/types/error.h"
#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
// What the projector's grey levels add to the difference of two periods' phases, rad: 8 bits and a ratio of 8.
constexpr double kPatternResidual = 0.03;
constexpr double kWrapSigmas = 4.5;
constexpr double kBorderPx = 0.5;  // how far noise may carry a coordinate past the projector's border
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Least-squares estimator of one period: rows give (I', I'' cos phi, -I'' sin phi) from the samples.
struct StepEstimator {
  FringeGroup group;
  Eigen::Matrix3Xd weights;

  explicit StepEstimator(FringeGroup g) : group(std::move(g)) {
    const auto steps = static_cast<Eigen::Index>(group.images.size());
    Eigen::MatrixX3d basis(steps, 3);
    for (Eigen::Index k = 0; k < steps; ++k) {
      const double shift = group.shifts_rad[static_cast<size_t>(k)];
      basis.row(k) << 1, std::cos(shift), std::sin(shift);
    }
    weights = (basis.transpose() * basis).inverse() * basis.transpose();
  }
};

struct PhaseSample {
  double mean = 0, modulation = 0, phase = 0, sigma = 0;
  bool clipped = false;
};

// Wrapped phase of one pixel and its sigma: phi = atan2(s, c) of the linear estimates s and c, so
// d phi = (c ds - s dc) / I''^2 is again linear in the samples.
PhaseSample estimate(const StepEstimator& estimator, const double* samples, const SensorModel& sensor,
                     double clip_level) {
  const Eigen::Index steps = estimator.weights.cols();
  double mean = 0, c = 0, s = 0;
  PhaseSample result;
  for (Eigen::Index k = 0; k < steps; ++k) {
    mean += estimator.weights(0, k) * samples[k];
    c += estimator.weights(1, k) * samples[k];
    s -= estimator.weights(2, k) * samples[k];
    result.clipped |= samples[k] >= clip_level;
  }
  const double power = c * c + s * s;
  double variance = 0;
  for (Eigen::Index k = 0; k < steps; ++k) {
    const double slope = (-c * estimator.weights(2, k) - s * estimator.weights(1, k)) / power;
    variance += slope * slope * sensor.variance_dn2(samples[k]);
  }
  result.mean = mean;
  result.modulation = std::sqrt(power);
  result.phase = std::atan2(s, c);
  result.sigma = std::sqrt(variance);
  return result;
}

struct RowReader {
  const FringeStack& stack;
  double operator()(int image, int row, int col) const {
    const cv::Mat& m = stack.images[static_cast<size_t>(image)];
    switch (m.depth()) {
      case CV_8U:
        return m.at<uchar>(row, col);
      case CV_16U:
        return m.at<ushort>(row, col);
      default:
        return static_cast<double>(m.at<float>(row, col));
    }
  }
};

void check_stack(const FringeStack& stack, const PatternSequence& sequence) {
  if (stack.images.size() != sequence.patterns.size())
    throw Error("stack " + std::to_string(stack.index) + " has " + std::to_string(stack.images.size()) +
                " images but the pattern sequence has " + std::to_string(sequence.patterns.size()));
  for (const cv::Mat& image : stack.images) {
    if (image.size() != stack.images.front().size() || image.type() != stack.images.front().type())
      throw Error("stack " + std::to_string(stack.index) + ": its images differ in size or type");
    if (image.type() != CV_8UC1 && image.type() != CV_16UC1 && image.type() != CV_32FC1)
      throw Error("stack " + std::to_string(stack.index) + ": images must be grey, 8 or 16 bit or float");
  }
}

// Coarsest period first.
std::vector<StepEstimator> make_estimators(const PatternSequence& sequence, Axis axis) {
  std::vector<StepEstimator> estimators;
  for (FringeGroup& group : fringe_groups(sequence, axis)) estimators.emplace_back(std::move(group));
  const int length = axis == Axis::columns ? sequence.width : sequence.height;
  if (estimators.empty() || estimators.front().group.period_px < length)
    throw Error("patterns: no " + std::string(axis == Axis::columns ? "column" : "row") +
                " fringe period covers the projector's " + std::to_string(length) +
                " px; absolute phase needs one that does");
  return estimators;
}

}  // namespace

void check_decodable(const PatternSequence& sequence, Axis axis) { make_estimators(sequence, axis); }

DecodedStack decode(const FringeStack& stack, const PatternSequence& sequence, const SensorModel& sensor,
                    const DecodeOptions& options, Axis axis) {
  check_options(options, "decode");
  check_stack(stack, sequence);
  const std::vector<StepEstimator> estimators = make_estimators(sequence, axis);
  const int length = axis == Axis::columns ? sequence.width : sequence.height;

  const cv::Size size = stack.images.front().size();
  DecodedStack out;
  out.index = stack.index;
  out.timestamp_s = stack.timestamp_s;
  out.full_scale_dn = sensor.max_dn();
  out.finest_period_px = estimators.back().group.period_px;
  for (cv::Mat1f* image :
       {&out.mean, &out.modulation, &out.wrapped_phase, &out.coordinate_px, &out.sigma_px, &out.confidence})
    *image = cv::Mat1f(size, kNaN);
  out.fringe_order = cv::Mat1i(size, -1);

  // The coarsest phase is unique over one period, which may be longer than the projector. What noise moves past a
  // border lies in the gap between the last column's phase and the first one's, half of it to each; in the middle of
  // the gap, or at the border where there is none, it cannot be told to which.
  const double gap_px = estimators.front().group.period_px - length;
  const double first_phase = -std::numbers::pi * gap_px / estimators.front().group.period_px;
  const double border_px = std::min(kBorderPx, gap_px / 2);
  const RowReader read{stack};
  const double clip_level = options.saturation * sensor.max_dn();
  for_each_row(size.height, [&](int row) {
    std::vector<double> samples(stack.images.size());
    for (int col = 0; col < size.width; ++col) {
      double absolute = 0, absolute_sigma = 0, right = 1;
      bool valid = true;
      PhaseSample phase;
      int order = 0;
      double mean_sum = 0;
      for (size_t g = 0; g < estimators.size(); ++g) {
        const FringeGroup& group = estimators[g].group;
        for (size_t k = 0; k < group.images.size(); ++k) samples[k] = read(group.images[k], row, col);
        phase = estimate(estimators[g], samples.data(), sensor, clip_level);
        mean_sum += phase.mean;
        valid = valid && !phase.clipped && phase.modulation >= options.min_modulation_dn &&
                phase.modulation >= options.min_data_modulation * phase.mean &&
                phase.sigma <= options.max_phase_sigma_rad;
        if (g == 0) {
          order = phase.phase < first_phase ? 1 : 0;
          // What noise would have had to do, had the light come from beyond the other border.
          const double unwrapped = phase.phase + kTwoPi * order;
          const double to_other_border = std::min(unwrapped - 2 * first_phase, kTwoPi - unwrapped);
          valid = valid && to_other_border >= kWrapSigmas * phase.sigma;
        } else {
          const double ratio = estimators[g - 1].group.period_px / group.period_px;
          order = static_cast<int>(std::lround((ratio * absolute - phase.phase) / kTwoPi));
          const double spread = std::hypot(ratio * absolute_sigma, phase.sigma);
          const double residual = ratio * absolute - (phase.phase + kTwoPi * order);
          valid =
              valid && std::abs(residual) <= options.max_order_residual_sigma * std::hypot(spread, kPatternResidual);
          right *= 1 - std::erfc(std::numbers::pi / (std::numbers::sqrt2 * spread));
        }
        absolute = phase.phase + kTwoPi * order;
        absolute_sigma = phase.sigma;
      }
      out.mean(row, col) = static_cast<float>(mean_sum / static_cast<double>(estimators.size()));
      out.modulation(row, col) = static_cast<float>(phase.modulation);
      const double coordinate = projector_coordinate(absolute, out.finest_period_px);
      valid = valid && 1 - right <= options.max_order_failure && coordinate >= -0.5 - border_px &&
              coordinate < length - 0.5 + border_px;
      if (!valid) continue;
      out.wrapped_phase(row, col) = static_cast<float>(phase.phase);
      out.fringe_order(row, col) = order;
      out.coordinate_px(row, col) = static_cast<float>(coordinate);
      out.sigma_px(row, col) = static_cast<float>(phase.sigma * out.finest_period_px / kTwoPi);
      out.confidence(row, col) = static_cast<float>(right);
    }
  });
  return out;
}

}  // namespace fringeslam
