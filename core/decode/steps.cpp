// SPDX-License-Identifier: Apache-2.0
#include "core/decode/steps.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "core/patterns/waveform.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Selects images of a group so that `steps` equally spaced shifts remain.
FringeGroup thinned(const FringeGroup& group, int steps) {
  const size_t all = group.images.size(), wanted = static_cast<size_t>(steps);
  if (steps == 0 || wanted == all) return group;
  FringeGroup result{group.axis, group.period_px, {}, {}};
  for (size_t k = 0; k < wanted; ++k) {
    const double target = group.shifts_rad.front() + kTwoPi * static_cast<double>(k) / steps;
    for (size_t i = 0; i < all; ++i) {
      if (std::abs(std::remainder(group.shifts_rad[i] - target, kTwoPi)) > 1e-6) continue;
      result.images.push_back(group.images[i]);
      result.shifts_rad.push_back(group.shifts_rad[i]);
      break;
    }
  }
  if (steps < 3 || result.images.size() != wanted)
    throw Error("decode.steps is " + std::to_string(steps) + " but the " + std::to_string(all) + " shifts of period " +
                to_text(group.period_px) + " px do not include " + std::to_string(steps) +
                " equally spaced ones; use a divisor of their number, at least 3");
  return result;
}

}  // namespace

std::vector<FringeGroup> select_groups(const PatternSequence& sequence, Axis axis, const DecodeOptions& options) {
  std::vector<FringeGroup> groups;
  for (const FringeGroup& group : fringe_groups(sequence, axis)) groups.push_back(thinned(group, options.steps));
  for (const FringeGroup& group : groups) {
    if (group.images.size() > kMaxSteps)
      throw Error("patterns: more than " + std::to_string(kMaxSteps) + " phase steps of one period");
  }
  if (groups.size() > kMaxGroups)
    throw Error("patterns: more than " + std::to_string(kMaxGroups) + " fringe periods in one axis");
  return groups;
}

StepEstimator least_squares(const FringeGroup& group) {
  const auto steps = static_cast<Eigen::Index>(group.images.size());
  Eigen::MatrixX3d basis(steps, 3);
  for (Eigen::Index k = 0; k < steps; ++k) {
    const double shift = group.shifts_rad[static_cast<size_t>(k)];
    basis.row(k) << 1, std::cos(shift), std::sin(shift);
  }
  const Eigen::Matrix3Xd weights = (basis.transpose() * basis).inverse() * basis.transpose();
  StepEstimator estimator;
  estimator.images = group.images;
  estimator.period_px = static_cast<float>(group.period_px);
  for (const double shift : group.shifts_rad) estimator.shift_turns.push_back(static_cast<float>(shift / kTwoPi));
  for (Eigen::Index k = 0; k < steps; ++k) {
    estimator.mean.push_back(static_cast<float>(weights(0, k)));
    estimator.cosine.push_back(static_cast<float>(weights(1, k)));
    estimator.sine.push_back(static_cast<float>(-weights(2, k)));
  }
  return estimator;
}

// The phase error of N steps depends on phi + delta_0, so the table for centred steps is shifted for other steps.
std::vector<float> correction_of(const FringeGroup& group, const PhaseCorrection& correction) {
  if (correction.offset_rad.empty() || correction.steps != static_cast<int>(group.images.size()) ||
      !equally_spaced(group.shifts_rad))
    return {};
  const double shift_turns = turns_from_centred(group.shifts_rad);
  std::vector<double> closed = correction.offset_rad;
  closed.push_back(closed.front());
  const auto offset_turns = [&](double turns) {
    const double at = turns + shift_turns;
    return interpolate_table(closed, at - std::floor(at)) / kTwoPi;
  };
  constexpr int kEntries = 1024;
  std::vector<float> table;
  for (int i = 0; i < kEntries; ++i) {
    const double measured = static_cast<double>(i) / kEntries;
    // Solve true + offset(true) = measured, which is monotonic, by bisection.
    double low = measured - 0.25, high = measured + 0.25;
    for (int iteration = 0; iteration < 40; ++iteration) {
      const double middle = 0.5 * (low + high);
      (middle + offset_turns(middle) < measured ? low : high) = middle;
    }
    table.push_back(static_cast<float>(measured - low));
  }
  return table;
}

EvenShifts nearest_even(std::vector<double> shifts_rad) {
  for (double& shift : shifts_rad) shift -= kTwoPi * std::floor(shift / kTwoPi);
  std::sort(shifts_rad.begin(), shifts_rad.end());
  const auto n = static_cast<double>(shifts_rad.size());
  double first = 0;
  for (size_t i = 0; i < shifts_rad.size(); ++i) first += (shifts_rad[i] - kTwoPi * static_cast<double>(i) / n) / n;
  EvenShifts even;
  for (size_t i = 0; i < shifts_rad.size(); ++i) {
    even.shifts_rad.push_back(first + kTwoPi * static_cast<double>(i) / n);
    even.off_rad = std::max(even.off_rad, std::abs(shifts_rad[i] - even.shifts_rad.back()));
  }
  return even;
}

bool EvenShifts::near() const { return off_rad <= kPi / 12; }

double EvenShifts::remaining() const {
  constexpr double kRemaining = 3.5;
  const double share = std::min(1.0, off_rad * static_cast<double>(shifts_rad.size()) / kPi);
  return kRemaining * kRemaining * share * share;
}

}  // namespace fringeslam
