// SPDX-License-Identifier: Apache-2.0
#include "core/types/fringe_stack.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "core/types/error.h"

namespace fringeslam {

std::vector<double> exposure_times_s(double timestamp_s, size_t images, const Timing& timing) {
  std::vector<double> times_s(images);
  for (size_t i = 0; i < images; ++i)
    times_s[i] =
        timestamp_s + (static_cast<double>(i) - 0.5 * (static_cast<double>(images) - 1)) / timing.camera_rate_hz;
  return times_s;
}

double reference_time_s(const PatternSequence& patterns, const std::vector<double>& exposure_time_s) {
  const size_t images = exposure_time_s.size();
  if (images == 0 || images != patterns.patterns.size())
    throw Error("a stack needs one exposure time per pattern; it has " + std::to_string(images) + " for " +
                std::to_string(patterns.patterns.size()) + " patterns");
  const auto middle_of = [&](const auto& counts) -> std::optional<double> {
    double sum_s = 0;
    int count = 0;
    for (size_t i = 0; i < images; ++i) {
      if (!counts(patterns.patterns[i])) continue;
      sum_s += exposure_time_s[i] - exposure_time_s.front();  // absolute times may be large
      ++count;
    }
    if (count == 0) return std::nullopt;
    return exposure_time_s.front() + sum_s / count;
  };
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    double finest_px = std::numeric_limits<double>::infinity();
    for (const Pattern& pattern : patterns.patterns) {
      if (pattern.coding == Coding::fringe && pattern.axis == axis) finest_px = std::min(finest_px, pattern.period_px);
    }
    const auto time_s = middle_of([&](const Pattern& pattern) {
      return pattern.coding == Coding::fringe && pattern.axis == axis && pattern.period_px == finest_px;
    });
    if (time_s) return *time_s;
  }
  return *middle_of([](const Pattern&) { return true; });
}

std::vector<double> exposure_times_s(double timestamp_s, const PatternSequence& patterns, const Timing& timing) {
  std::vector<double> times_s(patterns.patterns.size());
  for (size_t i = 0; i < times_s.size(); ++i) times_s[i] = static_cast<double>(i) / timing.camera_rate_hz;
  if (times_s.empty()) return times_s;
  const double reference_s = reference_time_s(patterns, times_s);
  for (double& time_s : times_s) time_s += timestamp_s - reference_s;
  return times_s;
}

double image_interval_s(const FringeStack& stack, const Timing& timing) {
  constexpr double kSame = 0.02;
  const double nominal_s = 1 / timing.camera_rate_hz;
  std::vector<double> intervals_s;
  for (size_t i = 1; i < stack.exposure_time_s.size(); ++i)
    intervals_s.push_back(stack.exposure_time_s[i] - stack.exposure_time_s[i - 1]);
  if (intervals_s.empty()) return nominal_s;
  const auto middle = intervals_s.begin() + static_cast<std::ptrdiff_t>(intervals_s.size() / 2);
  std::nth_element(intervals_s.begin(), middle, intervals_s.end());
  return *middle > 0 && std::abs(*middle - nominal_s) > kSame * nominal_s ? *middle : nominal_s;
}

void check_stack(const FringeStack& stack) {
  const std::string name = "stack " + std::to_string(stack.index);
  const size_t images = stack.images.size(), patterns = stack.patterns.patterns.size(),
               exposures = stack.exposure_s.size(), times = stack.exposure_time_s.size();
  if (patterns != images || exposures != images || times != images)
    throw Error(name + " has " + std::to_string(images) + " images, " + std::to_string(patterns) + " patterns, " +
                std::to_string(exposures) + " exposures and " + std::to_string(times) +
                " exposure times; there must be one of each per image");
  for (const cv::Mat& image : stack.images) {
    if (image.size() != stack.images.front().size() || image.type() != stack.images.front().type())
      throw Error(name + ": its images differ in size or type");
    if (image.type() != CV_8UC1 && image.type() != CV_16UC1 && image.type() != CV_32FC1)
      throw Error(name + ": images must be grey, 8 or 16 bit or float");
  }
}

}  // namespace fringeslam
