// SPDX-License-Identifier: Apache-2.0
// Fringe orders by a Gray code of a stack that was exposed in motion (docs/method.md, section 9.2). Each bit of a pixel is that
// of its own exposure's coordinate, so that the bits of one pixel may not be a word of the code. The orders that the
// phase leaves open are therefore compared with the images one by one.
#pragma once

#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

class GrayOrdersInMotion {
 public:
  // `period_px`: of the phase whose orders are found.
  GrayOrdersInMotion(const PatternSequence& sequence, Axis axis, double period_px);

  // Finds the order of each pixel of a row whose wrapped phase and mean intensity at the reference time are known, and
  // stores the absolute phase as the prior; NaN where no order, or more than one, agrees with the images.
  void find(const RowPlan& camera, const RowScratch& row, int width, const RowOutput& wrapped, RowPrior& found) const;

 private:
  struct CodeImage {
    size_t image = 0;               // in the stack
    std::vector<float> brightness;  // over the projector: 1 is white, -1 black; in between at edges, which are blurred
  };
  // Brightness of an image of the code at a coordinate; NaN beyond the projector's image.
  float brightness_at(const CodeImage& code, float coordinate_px) const;

  std::vector<CodeImage> images_;
  double period_px_ = 0;
  int orders_ = 0;
};

}  // namespace fringeslam
