// SPDX-License-Identifier: Apache-2.0
// Which patterns to project next: the whole sequence, or the finest fringes alone while the map predicts their fringe
// orders (docs/method.md, section 3.2).
#pragma once

#include "core/mapper/mapper.h"

namespace fringeslam {

// When the finest fringes may be projected alone.
enum class FinestAlone { never, in_motion, always };

class PatternSchedule {
 public:
  PatternSchedule(const PatternSequence& sequence, FinestAlone finest, double keyframe_overlap, double min_predicted);

  const PatternSequence& next() const { return wants_all_ ? sequence_ : finest_; }
  bool keeps_all() const { return finest_alone_ == FinestAlone::never; }
  // True if next() does not depend on views that are still to be processed. Changes once the robot moves during a view.
  bool is_fixed() const {
    return finest_alone_ == FinestAlone::never || (finest_alone_ == FinestAlone::in_motion && !has_moved_);
  }
  // Projects whole sequences only, unless the finest fringes are to be projected alone even at rest.
  void keep_all();
  // Takes the result of the newest view into account.
  void update(const FrameResult& result);

 private:
  bool leaves_fringes_unresolved(const DecodedStack& decoded) const;

  PatternSequence sequence_, finest_;
  FinestAlone finest_alone_;
  bool has_moved_ = false;
  double keyframe_overlap_, min_predicted_;
  bool wants_all_ = true;
  bool prediction_failed_ = false;  // since the last keyframe
};

}  // namespace fringeslam
