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

PhaseCorrection phase_correction_of(const std::vector<double>& response, int steps) {
  constexpr int kEntries = 360;
  if (steps < 3) throw Error("a phase requires at least three steps, not " + std::to_string(steps));
  PhaseCorrection correction{steps, {}};
  for (int i = 0; i < kEntries; ++i) {
    const double phase = kTwoPi * i / kEntries;
    double c = 0, s = 0;
    for (int k = 0; k < steps; ++k) {
      const double shift = kTwoPi * (k - 0.5 * (steps - 1)) / steps;
      const double light = interpolate_table(response, 0.5 + 0.5 * std::cos(phase + shift));
      c += light * std::cos(shift);
      s -= light * std::sin(shift);
    }
    correction.offset_rad.push_back(std::remainder(std::atan2(s, c) - phase, kTwoPi));
  }
  return correction;
}

double largest_offset_rad(const PhaseCorrection& correction) {
  double largest = 0;
  for (const double offset : correction.offset_rad) largest = std::max(largest, std::abs(offset));
  return largest;
}

}  // namespace fringeslam
