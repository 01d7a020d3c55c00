// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "core/score/score.h"
#include "core/types/error.h"

namespace fringeslam {

double quantile_of(std::vector<double> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double position = q * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::ptrdiff_t>(std::floor(position));
  std::nth_element(values.begin(), values.begin() + low, values.end());
  const double below = values[static_cast<size_t>(low)];
  if (static_cast<size_t>(low) + 1 == values.size()) return below;
  const double above = *std::min_element(values.begin() + low + 1, values.end());
  return below + (position - static_cast<double>(low)) * (above - below);
}

double median_of(std::vector<double> values) { return quantile_of(std::move(values), 0.5); }

MedianInterval median_interval_of(const std::vector<double>& values) {
  if (values.empty()) return {};
  constexpr int kResamples = 2000;
  // Its numbers are the same everywhere; those of the standard library's distributions are not.
  std::mt19937_64 random(1);
  std::vector<double> medians, sample(values.size());
  for (int resample = 0; resample < kResamples; ++resample) {
    for (double& value : sample) value = values[random() % values.size()];
    medians.push_back(median_of(sample));
  }
  return {median_of(values), quantile_of(medians, 0.025), quantile_of(medians, 0.975)};
}

namespace {

// True if the column is more than half a period from the true one. A mixed pixel may correctly measure a surface that
// lies in its area but not at its centre; there the ground truth of the 3x3 neighbourhood is accepted as well.
bool wrong_order(const TruthFrame& truth, int row, int col, double column_px, double period_px) {
  const auto agrees = [&](int r, int c) {
    return std::abs(column_px - static_cast<double>(truth.projector_column(r, c))) <= period_px / 2;
  };
  if (agrees(row, col)) return false;
  if (!(static_cast<int>(truth.mask(row, col)) & kTruthMixed)) return true;
  for (int r = std::max(0, row - 1); r <= std::min(truth.mask.rows - 1, row + 1); ++r) {
    for (int c = std::max(0, col - 1); c <= std::min(truth.mask.cols - 1, col + 1); ++c) {
      if (agrees(r, c)) return false;
    }
  }
  return true;
}

}  // namespace

double finest_period_px(const PatternSequence& sequence) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double fringes = kInfinity, gray = kInfinity;
  for (const Pattern& pattern : sequence.patterns) {
    if (pattern.coding == Coding::fringe) fringes = std::min(fringes, pattern.period_px);
    if (pattern.coding == Coding::product) fringes = std::min(fringes, pattern.carrier_px);
    if (pattern.coding == Coding::gray) gray = std::min(gray, pattern.period_px);
  }
  return std::isfinite(fringes) ? fringes : gray;
}

DepthScore score_depth(const DepthEstimate& estimate, const TruthFrame& truth, double finest_period_px) {
  const cv::Size size = truth.depth_m.size();
  if (estimate.depth_m.size() != size || estimate.projector_column.size() != size)
    throw Error("score: depth, coordinates and ground truth differ in size");
  DepthScore score;
  std::vector<double> errors;
  double squares = 0;
  int lit = 0, lit_valid = 0, wrong = 0;
  for (int row = 0; row < truth.depth_m.rows; ++row) {
    for (int col = 0; col < truth.depth_m.cols; ++col) {
      const int mask = static_cast<int>(truth.mask(row, col));
      const bool directly_lit = (mask & kTruthSurface) && (mask & kTruthInBeam) && !(mask & kTruthInShadow);
      const double depth = estimate.depth_m(row, col);
      lit += directly_lit;
      if (std::isnan(depth)) continue;
      if (!directly_lit) {
        ++score.spurious;
        continue;
      }
      ++lit_valid;
      const double error = std::abs(depth - truth.depth_m(row, col));
      errors.push_back(error);
      squares += error * error;
      wrong += wrong_order(truth, row, col, static_cast<double>(estimate.projector_column(row, col)), finest_period_px);
    }
  }
  score.compared = static_cast<int>(errors.size());
  score.valid_fraction = lit ? static_cast<double>(lit_valid) / lit : 0;
  if (errors.empty()) return score;
  const auto n = static_cast<double>(errors.size());
  score.rms_m = std::sqrt(squares / n);
  score.wrong_order = wrong / n;
  score.median_m = median_of(errors);
  score.p99_m = quantile_of(std::move(errors), 0.99);
  return score;
}

}  // namespace fringeslam
