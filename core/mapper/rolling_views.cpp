// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/rolling_views.h"

#include <cmath>
#include <utility>

#include "core/base/constants.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr size_t kLeastShifts = 3;

bool are_equal_shifts(double a_rad, double b_rad) {
  constexpr double kSame_rad = 1e-6;
  return std::abs(std::remainder(a_rad - b_rad, kTwoPi)) < kSame_rad;
}

}  // namespace

RollingViews::RollingViews(const PatternSequence& sequence, const Timing& timing, int images, Axis axis)
    : finest_(sequence), interval_s_(1 / timing.camera_rate_hz), axis_(axis), images_(static_cast<size_t>(images)) {
  const auto groups = fringe_groups(sequence, axis);
  if (groups.empty()) throw Error("rolling views: the sequence has no fringes along the requested axis");
  if (images_ < kLeastShifts)
    throw Error("rolling views: " + std::to_string(images) +
                " images per view do not determine the phase; use 3 or more");
  period_px_ = groups.back().period_px;
  finest_.patterns.clear();
}

std::optional<FringeStack> RollingViews::push(TimedImage image) {
  last_.push_back(std::move(image));
  if (last_.size() > images_) last_.pop_front();
  if (!complete()) return std::nullopt;
  FringeStack stack;
  stack.index = index_++;
  stack.patterns = finest_;
  for (const TimedImage& each : last_) {
    stack.patterns.patterns.push_back(each.pattern);
    stack.images.push_back(each.image);
    stack.exposure_s.push_back(each.exposure_s);
    stack.exposure_time_s.push_back(each.exposure_time_s);
  }
  stack.timestamp_s = reference_time_s(stack.patterns, stack.exposure_time_s);
  return stack;
}

bool RollingViews::complete() const {
  constexpr double kLongestIntervals = 1.5;  // a gap of two is a dropped image
  if (last_.size() < images_) return false;
  std::vector<double> shifts_rad;
  for (size_t i = 0; i < last_.size(); ++i) {
    const Pattern& pattern = last_[i].pattern;
    if (pattern.coding != Coding::fringe || pattern.axis != axis_ || pattern.period_px != period_px_) return false;
    if (i > 0 && !(last_[i].exposure_time_s > last_[i - 1].exposure_time_s &&
                   last_[i].exposure_time_s - last_[i - 1].exposure_time_s < kLongestIntervals * interval_s_))
      return false;
    bool known = false;
    for (const double shift : shifts_rad) known |= are_equal_shifts(shift, pattern.shift_rad);
    if (!known) shifts_rad.push_back(pattern.shift_rad);
  }
  return shifts_rad.size() >= kLeastShifts;
}

}  // namespace fringeslam
