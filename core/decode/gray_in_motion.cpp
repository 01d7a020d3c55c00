// SPDX-License-Identifier: Apache-2.0
#include "core/decode/gray_in_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "core/base/constants.h"
#include "core/decode/gray.h"
#include "core/decode/steps.h"

namespace fringeslam {

namespace {

constexpr int kPerPx = 4;  // entries of the table of an image's brightness
// Blur of an edge between stripes extends this far into them, but not to the middle of a cell; without blur, an edge is
// where the coordinate, which is not exact, says.
constexpr double kBlurPx = 2, kSharpPx = 0.5;

}  // namespace

GrayOrdersInMotion::GrayOrdersInMotion(const PatternSequence& sequence, Axis axis, double period_px)
    : period_px_(period_px) {
  const int length_px = length_of(sequence, axis);
  orders_ = static_cast<int>(std::ceil(length_px / period_px)) + 1;
  double least_cell_px = length_px;
  for (const Pattern& pattern : sequence.patterns) {
    if (pattern.coding == Coding::gray && pattern.axis == axis)
      least_cell_px = std::min(least_cell_px, pattern.period_px);
  }
  const double blur_px = std::min(kBlurPx, 0.25 * least_cell_px);
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::gray || pattern.axis != axis) continue;
    const auto brightness = [&](double coordinate_px) { return 2 * ideal_intensity(pattern, coordinate_px) - 1; };
    CodeImage code{i, {}};
    for (int k = 0; k < kPerPx * length_px; ++k) {
      constexpr int kParts = 16;
      const double coordinate_px = (k + 0.5) / kPerPx - 0.5;
      double blurred = 0;
      for (int part = 0; part < kParts; ++part)
        blurred += brightness(coordinate_px + blur_px * ((2 * part + 1.0) / kParts - 1)) / kParts;
      const auto [low, high] =
          std::minmax({blurred, brightness(coordinate_px - kSharpPx), brightness(coordinate_px + kSharpPx)});
      code.brightness.push_back({static_cast<float>(low), static_cast<float>(high)});
    }
    images_.push_back(std::move(code));
  }
}

GrayOrdersInMotion::Brightness GrayOrdersInMotion::brightness_at(const CodeImage& code, float coordinate_px) const {
  constexpr float kBeyond = std::numeric_limits<float>::quiet_NaN();
  const float entry = std::floor((coordinate_px + 0.5f) * kPerPx);
  if (!(entry >= 0 && entry < static_cast<float>(code.brightness.size()))) return {kBeyond, kBeyond};
  return code.brightness[static_cast<size_t>(entry)];
}

void GrayOrdersInMotion::find(const RowPlan& camera, const RowScratch& row, int width, const RowOutput& wrapped,
                              RowPrior& found) const {
  // Squared differences between the expected and the measured brightness, summed over the images. A wrong bit differs by
  // 2; a pixel that sees two surfaces has bits in between.
  constexpr float kMost = 0.3f, kLeastApart = 2;
  // With a nonlinear projector, the mean of the fringes is not halfway between black and white. At gamma 2.5, black and white
  // are still within this ratio.
  constexpr float kLeastRatio = 0.4f;
  constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> contrast_dn(images_.size()), drift_px(images_.size());
  for (int i = 0; i < width; ++i) {
    const auto at = static_cast<size_t>(i);
    found.turns[at] = kUnknown;
    found.half_width[at] = found.sigma[at] = found.failure[at] = 0;
    const float turns = wrapped.wrapped_phase[i] / kTwoPiFloat;
    float white_dn = 0, black_dn = 0;
    bool seen = turns == turns;
    for (size_t k = 0; k < images_.size(); ++k) {
      drift_px[k] = row.drift_px[images_[k].image][i];
      contrast_dn[k] = row.samples[images_[k].image][i] - wrapped.mean[i];
      white_dn = std::max(white_dn, contrast_dn[k]);
      black_dn = std::max(black_dn, -contrast_dn[k]);
      seen = seen && drift_px[k] == drift_px[k];
    }
    if (!seen || !(white_dn + black_dn > 0)) continue;
    // Where no image is black, or none white, the other bounds it.
    std::tie(white_dn, black_dn) =
        std::pair(std::max(white_dn, kLeastRatio * black_dn), std::max(black_dn, kLeastRatio * white_dn));
    const auto expected = [&](size_t k, int order) {
      const float coordinate_px = (turns + static_cast<float>(order)) * static_cast<float>(period_px_) - 0.5f;
      return brightness_at(images_[k], coordinate_px + drift_px[k]);
    };
    float least = std::numeric_limits<float>::infinity(), next = least;
    int best = -1, other = -1;
    for (int order = 0; order < orders_; ++order) {
      float sum = 0;
      for (size_t k = 0; k < images_.size() && sum < next; ++k) {
        const Brightness b = expected(k, order);
        const float off = b.distance(contrast_dn[k] / (contrast_dn[k] > 0 ? white_dn : black_dn));
        sum += b.low == b.low ? off * off : std::numeric_limits<float>::infinity();
      }
      if (sum < least) {
        next = std::exchange(least, sum);
        other = std::exchange(best, order);
      } else if (sum < next) {
        next = sum;
        other = order;
      }
    }
    if (!(least <= kMost) || next - least < kLeastApart) continue;
    found.turns[at] = turns + static_cast<float>(best);
    if (other < 0) continue;
    // The difference of both sums is linear in the gray values, whose mean is at most as noisy as one of them.
    float variance = 0;
    for (size_t k = 0; k < images_.size(); ++k) {
      const float slope = 2 * (expected(k, best).middle() - expected(k, other).middle()) / std::min(white_dn, black_dn);
      variance += 2 * slope * slope * gray_value_variance(camera, row.samples[images_[k].image][i]);
    }
    found.failure[at] = 0.5f * std::erfc((next - least) / std::sqrt(2 * variance));
  }
}

}  // namespace fringeslam
