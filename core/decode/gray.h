// SPDX-License-Identifier: Apache-2.0
// Gray codes: bits of a pixel by comparison, the cell they name, and how sure that is.
#pragma once

#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

class GrayDecoder {
 public:
  // `fringes`: the estimator of the period whose mean is the bits' threshold where there is neither an inverted image
  // of a bit nor a white and a black one; null when there are no fringes. Throws Error when bits are missing or
  // nothing can be compared with.
  GrayDecoder(const PatternSequence& sequence, Axis axis, const StepEstimator* fringes);

  double cell_px() const { return bits_.back().cell_px; }

  struct Reading {
    int cell = 0;
    // Probabilities that noise changed it: to a neighbouring cell, as happens on their edges, and to a far one.
    double neighbour = 0, far = 0;
    // Of the faintest bit and of the clearest. A bit that tells neighbouring cells apart does not count as the
    // faintest: on their edge it has no contrast. Pixels that see two surfaces have other bits in between.
    float contrast_dn = 0, best_contrast_dn = 0;
  };
  // `samples`: grey values of the stack's images at one pixel.
  Reading read(const RowPlan& camera, const float* const* samples, int col) const;

 private:
  struct Comparison {
    float difference = 0, variance = 0;
  };
  // Whether the code with one bit turned over names a neighbouring cell; without fringes, one of the next few.
  bool is_neighbour(unsigned code, size_t bit) const;
  Comparison compare(const RowPlan& camera, const float* const* samples, int col, const GrayBit& bit) const;

  std::vector<GrayBit> bits_;  // coarsest first, cells halving
  const StepEstimator* fringes_;
  int white_ = -1, black_ = -1;
};

}  // namespace fringeslam
