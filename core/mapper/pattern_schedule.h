// SPDX-License-Identifier: Apache-2.0
// Which patterns to project next: the whole sequence, or with `decode.unwrapping=predicted` the finest fringes alone
// while the map predicts their fringe orders (docs/method.md, section 3.2).
#pragma once

#include "core/mapper/mapper.h"

namespace fringeslam {

class PatternSchedule {
 public:
  // `predicted`: whether fringe orders may come from the map.
  PatternSchedule(const PatternSequence& sequence, bool predicted, double keyframe_overlap, double min_predicted);

  const PatternSequence& next() const { return wants_all_ ? sequence_ : finest_; }
  // True if next() does not depend on views that are still to be processed.
  bool is_fixed() const { return !predicted_; }
  // Takes the result of the newest view into account.
  void update(const FrameResult& result);

 private:
  bool leaves_fringes_unresolved(const DecodedStack& decoded) const;

  PatternSequence sequence_, finest_;
  bool predicted_;
  double keyframe_overlap_, min_predicted_;
  bool wants_all_ = true;
  bool prediction_failed_ = false;  // since the last keyframe
};

}  // namespace fringeslam
