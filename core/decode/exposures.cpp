// SPDX-License-Identifier: Apache-2.0
#include "core/decode/exposures.h"

#include <algorithm>
#include <set>
#include <string>

#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/grey_value.h"

namespace fringeslam {

namespace {

// Images of one pattern, shortest exposure first.
struct Bracket {
  Pattern pattern;  // at the rig's exposure
  std::vector<size_t> images;
};

std::vector<Bracket> brackets_of(const FringeStack& stack) {
  std::vector<Bracket> brackets;
  for (size_t i = 0; i < stack.images.size(); ++i) {
    Pattern pattern = stack.patterns.patterns[i];
    pattern.exposure = 1;
    auto bracket =
        std::find_if(brackets.begin(), brackets.end(), [&](const Bracket& b) { return b.pattern == pattern; });
    if (bracket == brackets.end()) bracket = brackets.insert(brackets.end(), Bracket{pattern, {}});
    bracket->images.push_back(i);
  }
  for (Bracket& bracket : brackets)
    std::stable_sort(bracket.images.begin(), bracket.images.end(),
                     [&](size_t a, size_t b) { return stack.exposure_s[a] < stack.exposure_s[b]; });
  return brackets;
}

}  // namespace

CombinedExposures combine_exposures(const FringeStack& stack, const SensorModel& sensor, double clip_dn) {
  check_stack(stack);
  if (std::any_of(stack.exposure_s.begin(), stack.exposure_s.end(), [](double s) { return !(s > 0); }))
    throw Error("stack " + std::to_string(stack.index) + ": an exposure time is not positive");
  CombinedExposures result;
  FringeStack& combined = result.stack;
  combined.index = stack.index;
  combined.timestamp_s = stack.timestamp_s;
  combined.patterns = stack.patterns;
  combined.patterns.patterns.clear();
  const double rig_exposure_s = stack.exposure_s.front() / stack.patterns.patterns.front().exposure;
  const auto [shortest_s, longest_s] = std::minmax_element(stack.exposure_s.begin(), stack.exposure_s.end());
  result.longest = *longest_s / rig_exposure_s;
  const double per_shortest = rig_exposure_s / *shortest_s;
  const auto offset = static_cast<float>(sensor.offset_dn), clip = static_cast<float>(clip_dn),
             constant = static_cast<float>(sensor.variance_dn2(sensor.offset_dn)),
             per_dn = static_cast<float>(sensor.gain_dn_per_electron);
  // Rounding must not move an unsaturated value past the limit.
  result.clip_dn = static_cast<float>(sensor.offset_dn + (clip_dn - sensor.offset_dn) * per_shortest * (1 + 1e-5));
  const float saturated = std::max(
      static_cast<float>(sensor.offset_dn + (sensor.max_dn() - sensor.offset_dn) * per_shortest), result.clip_dn);

  for (const Bracket& bracket : brackets_of(stack)) {
    std::vector<float> exposures;
    double middle_s = 0;
    for (const size_t i : bracket.images) {
      exposures.push_back(static_cast<float>(stack.exposure_s[i] / rig_exposure_s));
      middle_s += (stack.exposure_time_s[i] - stack.timestamp_s) / static_cast<double>(bracket.images.size());
    }
    cv::Mat1f image(stack.images.front().size()), variance(image.size());
    for_each_row(image.rows, [&](int row) {
      for (int col = 0; col < image.cols; ++col) {
        // Shortest first: a sample near saturation is judged by shorter ones, not by its own noise alone.
        float light = 0, exposure = 0;
        size_t used = 0;
        for (; used < exposures.size(); ++used) {
          const float grey = grey_value(stack.images[bracket.images[used]], row, col);
          const bool predicted_below = used == 0 || offset + exposures[used] * light / exposure < clip;
          if (grey >= clip || !predicted_below) break;
          light += grey - offset;
          exposure += exposures[used];
        }
        if (used == 0) {
          image(row, col) = saturated;
          variance(row, col) = constant + per_dn * (saturated - offset);
          continue;
        }
        const float rate = std::max(light / exposure, 0.0f);
        float weighted = 0, weight = 0;
        for (size_t k = 0; k < used; ++k) {
          const float grey = grey_value(stack.images[bracket.images[k]], row, col);
          const float per_variance = exposures[k] / (constant + per_dn * exposures[k] * rate);
          weighted += per_variance * (grey - offset);
          weight += per_variance * exposures[k];
        }
        image(row, col) = offset + weighted / weight;
        variance(row, col) = 1 / weight;
      }
    });
    combined.patterns.patterns.push_back(bracket.pattern);
    combined.images.push_back(image);
    combined.exposure_s.push_back(rig_exposure_s);
    combined.exposure_time_s.push_back(stack.timestamp_s + middle_s);
    result.variance_dn2.push_back(variance);
  }
  return result;
}

double clearest_exposure(const FringeStack& stack, double clip_dn) {
  check_stack(stack);
  constexpr int kStride = 8;
  const std::vector<Pattern>& patterns = stack.patterns.patterns;
  const std::set<double> exposures = [&] {
    std::set<double> all;
    for (const Pattern& pattern : patterns) all.insert(pattern.exposure);
    return all;
  }();
  const auto contrast_at = [&](double exposure) {
    double sum = 0;
    for (int row = kStride / 2; row < stack.images[0].rows; row += kStride) {
      for (int col = kStride / 2; col < stack.images[0].cols; col += kStride) {
        double low = clip_dn, high = 0;
        for (size_t i = 0; i < patterns.size(); ++i) {
          if (patterns[i].exposure != exposure) continue;
          const auto grey = static_cast<double>(grey_value(stack.images[i], row, col));
          low = std::min(low, grey);
          high = std::max(high, grey);
        }
        if (high < clip_dn) sum += std::max(0.0, high - low);
      }
    }
    return sum;
  };
  double best = 1, most = -1;
  for (const double exposure : exposures) {
    const double contrast = contrast_at(exposure);
    if (contrast > most) best = exposure, most = contrast;
  }
  return best;
}

FringeStack images_at(const FringeStack& stack, double exposure) {
  const std::vector<Pattern>& patterns = stack.patterns.patterns;
  FringeStack one = stack;
  one.patterns.patterns.clear();
  one.images.clear();
  one.exposure_s.clear();
  one.exposure_time_s.clear();
  for (size_t i = 0; i < patterns.size(); ++i) {
    if (patterns[i].exposure != exposure) continue;
    one.patterns.patterns.push_back(patterns[i]);
    one.images.push_back(stack.images[i]);
    one.exposure_s.push_back(stack.exposure_s[i]);
    one.exposure_time_s.push_back(stack.exposure_time_s[i]);
  }
  return one;
}

FringeStack best_exposure(const FringeStack& stack, double clip_dn) {
  return images_at(stack, clearest_exposure(stack, clip_dn));
}

FringeStack as_one_exposure(FringeStack stack) {
  for (Pattern& pattern : stack.patterns.patterns) pattern.exposure = 1;
  return stack;
}

FringeStack OneExposure::of(const FringeStack& stack) {
  if (!(stack.patterns == patterns_)) {
    exposure_ = clearest_exposure(stack, clip_dn_);
    patterns_ = stack.patterns;
  }
  return as_one_exposure(images_at(stack, exposure_));
}

}  // namespace fringeslam
