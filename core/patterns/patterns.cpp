// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/patterns.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {
constexpr double kTwoPi = 2 * std::numbers::pi;

// Shifts that differ by whole turns show the same pattern.
size_t distinct_shifts(const std::vector<double>& shifts_rad) {
  std::vector<double> distinct;
  for (const double shift : shifts_rad) {
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](double other) {
      return std::abs(std::remainder(shift - other, kTwoPi)) < 1e-6;
    });
    if (!known) distinct.push_back(shift);
  }
  return distinct.size();
}

}  // namespace

double absolute_phase(double coordinate_px, double period_px) { return kTwoPi * (coordinate_px + 0.5) / period_px; }

double projector_coordinate(double absolute_phase_rad, double period_px) {
  return absolute_phase_rad * period_px / kTwoPi - 0.5;
}

PatternSequence phase_shift_sequence(int width, int height, const std::vector<double>& periods_px, int steps, Axis axis,
                                     int bits) {
  PatternSequence sequence{width, height, {}};
  for (const double period : periods_px) {
    for (int step = 0; step < steps; ++step)
      sequence.patterns.push_back({axis, period, kTwoPi * (step - 0.5 * (steps - 1)) / steps, bits});
  }
  return sequence;
}

std::vector<FringeGroup> fringe_groups(const PatternSequence& sequence, Axis axis) {
  std::vector<FringeGroup> groups;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.axis != axis) continue;
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&](const FringeGroup& g) { return g.period_px == pattern.period_px; });
    if (group == groups.end()) group = groups.insert(groups.end(), FringeGroup{axis, pattern.period_px, {}, {}});
    group->images.push_back(static_cast<int>(i));
    group->shifts_rad.push_back(pattern.shift_rad);
  }
  for (const FringeGroup& group : groups) {
    if (distinct_shifts(group.shifts_rad) < 3)
      throw Error("patterns: period " + to_text(group.period_px) +
                  " px has fewer than three distinct phase shifts; add steps");
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const auto& a, const auto& b) { return a.period_px > b.period_px; });
  return groups;
}

double ideal_intensity(const Pattern& pattern, double coordinate_px) {
  return 0.5 + 0.5 * std::cos(absolute_phase(coordinate_px, pattern.period_px) + pattern.shift_rad);
}

std::vector<float> intensity_profile(const Pattern& pattern, int length_px) {
  std::vector<float> profile(static_cast<size_t>(length_px));
  const double levels = pattern.bits > 0 ? static_cast<double>((1 << pattern.bits) - 1) : 0;
  for (int i = 0; i < length_px; ++i) {
    const double ideal = ideal_intensity(pattern, i);
    profile[static_cast<size_t>(i)] = static_cast<float>(levels > 0 ? std::round(ideal * levels) / levels : ideal);
  }
  return profile;
}

cv::Mat1b pattern_image(const Pattern& pattern, int width, int height) {
  const bool columns = pattern.axis == Axis::columns;
  const std::vector<float> profile = intensity_profile(pattern, columns ? width : height);
  cv::Mat1b image(height, width);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col)
      image(row, col) = static_cast<uchar>(std::lround(255 * profile[static_cast<size_t>(columns ? col : row)]));
  }
  return image;
}

}  // namespace fringeslam
