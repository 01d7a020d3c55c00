// SPDX-License-Identifier: Apache-2.0
// Views at camera rate: any N consecutive images of the cycling finest fringes make a stack, with the patterns in the
// order in which they were shown.
#pragma once

#include <deque>
#include <optional>

#include "core/types/fringe_stack.h"

namespace fringeslam {

// One camera image.
struct TimedImage {
  cv::Mat image;  // as in FringeStack
  Pattern pattern;
  double exposure_s = 0;
  double exposure_time_s = 0;  // middle of the exposure
};

class RollingViews {
 public:
  // `images` is the number of images per stack, at least 3; `sequence` determines the finest period along `axis`. Throws
  // Error if the sequence has no fringes there.
  RollingViews(const PatternSequence& sequence, const Timing& timing, int images = 3, Axis axis = Axis::columns);

  // Takes the next image and returns the stack that ends with it, with the time stamp in the middle of its exposures.
  // Empty unless the last images all show the finest fringes, with at least three different shifts, and follow each other
  // at the camera rate. Stacks are numbered from 0.
  std::optional<FringeStack> push(TimedImage image);

 private:
  bool complete() const;

  PatternSequence finest_;  // without its patterns
  double period_px_, interval_s_;
  Axis axis_;
  size_t images_;
  std::deque<TimedImage> last_;
  int index_ = 0;
};

}  // namespace fringeslam
