// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/pattern_schedule.h"

#include "core/patterns/patterns.h"

namespace fringeslam {

PatternSchedule::PatternSchedule(const PatternSequence& sequence, FinestAlone finest, double keyframe_overlap,
                                 double min_predicted)
    : sequence_(sequence),
      finest_(finest_patterns(sequence, Axis::columns)),
      finest_alone_(finest),
      keyframe_overlap_(keyframe_overlap),
      min_predicted_(min_predicted) {}

bool PatternSchedule::leaves_fringes_unresolved(const DecodedStack& decoded) const {
  const double fringes = cv::countNonZero(decoded.wrapped_phase == decoded.wrapped_phase);
  const double orders = cv::countNonZero(decoded.coordinate_px == decoded.coordinate_px);
  return orders < min_predicted_ * fringes;
}

void PatternSchedule::keep_all() {
  if (finest_alone_ == FinestAlone::in_motion) finest_alone_ = FinestAlone::never;
}

void PatternSchedule::update(const FrameResult& result) {
  const bool moves = result.in_motion() && !result.motion_unknown();
  has_moved_ |= moves;
  if (!has_pose(result.tracking)) {
    wants_all_ = true;
    prediction_failed_ |= !result.complete;
    return;
  }
  if (result.keyframe >= 0) prediction_failed_ = false;
  const bool leaves_keyframe =
      result.keyframe < 0 && (result.registration.icp.overlap < keyframe_overlap_ || result.unlinked >= 0);
  const bool finest = finest_alone_ == FinestAlone::always || (finest_alone_ == FinestAlone::in_motion && moves);
  wants_all_ = !finest || prediction_failed_ || result.tracking != Tracking::followed || leaves_keyframe ||
               leaves_fringes_unresolved(result.decoded) || result.predictable < min_predicted_;
}

}  // namespace fringeslam
