// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/waveform.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/constants.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"

namespace fringeslam {

bool equally_spaced(const std::vector<double>& shifts_rad) {
  const auto count = static_cast<double>(shifts_rad.size());
  std::vector<bool> seen(shifts_rad.size(), false);
  for (const double shift : shifts_rad) {
    const double place = (shift - shifts_rad.front()) * count / kTwoPi;
    if (std::abs(place - std::round(place)) > 1e-3) return false;
    const auto index = static_cast<long>(std::lround(place)) % static_cast<long>(shifts_rad.size());
    seen[static_cast<size_t>(index < 0 ? index + static_cast<long>(shifts_rad.size()) : index)] = true;
  }
  return std::find(seen.begin(), seen.end(), false) == seen.end();
}

double turns_from_centred(const std::vector<double>& shifts_rad) {
  const auto steps = static_cast<double>(shifts_rad.size());
  return *std::min_element(shifts_rad.begin(), shifts_rad.end()) / kTwoPi + 0.5 * (steps - 1) / steps;
}

std::vector<double> gamma_table(double gamma, int entries) {
  std::vector<double> table;
  for (int i = 0; i < entries; ++i) table.push_back(std::pow(static_cast<double>(i) / (entries - 1), gamma));
  return table;
}

std::vector<double> composed_table(const std::vector<double>& outer, const std::vector<double>& inner) {
  std::vector<double> table = inner;
  for (double& value : table) value = interpolate_table(outer, value);
  return inner.empty() ? outer : table;
}

namespace {

// Mean, and cosine and sine components, of steps centred on zero at a true phase.
struct StepSums {
  double mean = 0, c = 0, s = 0;
};
StepSums sums_of(const std::vector<double>& response, int steps, double phase) {
  StepSums sums;
  for (int k = 0; k < steps; ++k) {
    const double shift = kTwoPi * (k - 0.5 * (steps - 1)) / steps;
    const double light = interpolate_table(response, 0.5 + 0.5 * std::cos(phase + shift)) / steps;
    sums.mean += light;
    sums.c += 2 * light * std::cos(shift);
    sums.s -= 2 * light * std::sin(shift);
  }
  return sums;
}

constexpr int kPhases = 360;
double phase_at(int i) { return kTwoPi * i / kPhases; }

}  // namespace

PhaseCorrection phase_correction_of(const std::vector<double>& response, int steps) {
  if (steps < 3) throw Error("a phase requires at least three steps, not " + std::to_string(steps));
  PhaseCorrection correction{steps, {}};
  for (int i = 0; i < kPhases; ++i) {
    const StepSums sums = sums_of(response, steps, phase_at(i));
    correction.offset_rad.push_back(std::remainder(std::atan2(sums.s, sums.c) - phase_at(i), kTwoPi));
  }
  return correction;
}

std::vector<double> mean_ripple_of(const std::vector<double>& response, int steps) {
  if (response.empty()) return {};
  std::vector<double> means, modulations;
  double average = 0;
  for (int i = 0; i < kPhases; ++i) {
    const StepSums sums = sums_of(response, steps, phase_at(i));
    means.push_back(sums.mean);
    modulations.push_back(std::hypot(sums.c, sums.s));
    average += sums.mean / kPhases;
  }
  for (size_t i = 0; i < means.size(); ++i) means[i] = (means[i] - average) / modulations[i];
  return means;
}

double largest_offset_rad(const PhaseCorrection& correction) {
  double largest = 0;
  for (const double offset : correction.offset_rad) largest = std::max(largest, std::abs(offset));
  return largest;
}

}  // namespace fringeslam
