// SPDX-License-Identifier: Apache-2.0
// Decodes Gray codes: bits by comparison, the cell index, and its error probability.
#pragma once

#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

// Minimum contrast of a bit relative to the pixel's highest-contrast bit; a pixel that sees two surfaces has bits in
// between.
constexpr float kLeastGrayContrast = 0.5f;

// Returns the variance of a gray value by the camera's noise, DN^2.
float gray_value_variance(const RowPlan& camera, float grey);

class GrayDecoder {
 public:
  // `fringes`: the estimator of the period whose mean intensity is the threshold for bits that have neither an inverted
  // image nor a white and a black image; null if there are no fringes. Throws Error if bits are missing or there is no
  // threshold.
  GrayDecoder(const PatternSequence& sequence, Axis axis, const StepEstimator* fringes);

  double cell_px() const { return bits_.back().cell_px; }

  struct Reading {
    int cell = 0;
    // Probabilities that noise changed the cell: to a neighbouring cell, as happens at cell edges, or to a distant one.
    double neighbour = 0, far = 0;
    double variance_cells2 = 0;  // of the cell's number, due to bits that distinguish neighbours
    // Contrast of the lowest- and highest-contrast bits. A bit that distinguishes neighbouring cells is excluded from
    // the lowest, because it has no contrast at the edge between them. At pixels that see two surfaces other bits have
    // low contrast, too.
    float contrast_dn = 0, best_contrast_dn = 0;
  };
  // Decodes column `col`; `samples` are rows of grey values of the stack's images. Returns only the best contrast, and an
  // error as certain, if that is below `least_contrast_dn`.
  Reading read(const RowPlan& camera, const float* const* samples, int col, float least_contrast_dn = 0) const;

 private:
  struct Comparison {
    float difference = 0, variance = 0;
    float relative_contrast = 0;  // of two combined bits: that of the fainter one relative to the other
  };
  // Throws Error if bits are missing.
  void check_cells(int length);
  void check_long_runs(int length);
  int cell_of(unsigned code) const;
  // Distance of the cell that a wrong bit would give.
  int cells_off(unsigned code, size_t bit) const;
  // True if flipping one bit of the code gives a neighbouring cell or, without fringes, one of the next few.
  bool is_neighbour(unsigned code, size_t bit) const;
  static Comparison combined(const Comparison& one, const Comparison& other);
  Comparison compare(const RowPlan& camera, const float* const* samples, int col, const GrayBit& bit) const;

  std::vector<GrayBit> bits_;    // coarsest first, cell widths halving
  std::vector<size_t> carrier_;  // for each bit, the one that it is combined with; itself if none
  std::vector<int> cells_;       // of each word of a code with long runs; empty for a reflected code
  const StepEstimator* fringes_;
  int white_ = -1, black_ = -1;
};

}  // namespace fringeslam
