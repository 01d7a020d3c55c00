// SPDX-License-Identifier: Apache-2.0
// Fringe orders by a Gray code of a stack that was exposed in motion (docs/method.md, section 9.2). Each bit of a pixel is that
// of its own exposure's coordinate, so that the bits of one pixel may not be a word of the code. The orders that the
// phase leaves open are therefore compared with the images one by one.
#pragma once

#include <algorithm>
#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

class GrayOrdersInMotion {
 public:
  // `period_px` is the period of the phase whose orders are found.
  GrayOrdersInMotion(const PatternSequence& sequence, Axis axis, double period_px);

  // Finds the order of each pixel of a row whose wrapped phase and mean intensity at the reference time are known, and
  // stores the absolute phase as the prior; NaN where no order, or more than one, agrees with the images.
  void find(const RowPlan& camera, const RowScratch& row, int width, const RowOutput& wrapped, RowPrior& found) const;

 private:
  // 1 is white, -1 black. At the edges of stripes, whose blur is not known, the brightness is only known to lie in a range.
  struct Brightness {
    float low = 0, high = 0;

    float middle() const { return 0.5f * (low + high); }
    float distance(float brightness) const { return std::max({0.0f, low - brightness, brightness - high}); }
  };
  struct CodeImage {
    size_t image = 0;                    // in the stack
    std::vector<Brightness> brightness;  // over the projector
  };
  // Brightness of an image of the code at a coordinate; NaN beyond the projector's image.
  Brightness brightness_at(const CodeImage& code, float coordinate_px) const;

  std::vector<CodeImage> images_;
  double period_px_ = 0;
  int orders_ = 0;
};

}  // namespace fringeslam
