// SPDX-License-Identifier: Apache-2.0
// Micro phase shifting (Gupta and Nayar, CVPR 2012; docs/method.md, section 3.2): fringe orders from single images of
// further periods in a narrow band of short periods.
//
// All periods are so short that indirect light, which is smooth, contributes the same constant to all images. At a
// pixel, the phase steps of the first period give I', I'' and phi. Each candidate order K then predicts every other image,
// I_f = I' + I'' cos(2 pi x / p_f + delta_f) with x = p (phi / 2 pi + K). The candidate whose least squares over all
// images, with I', I'' and phi free, leaves the smallest residuals is the order; its fit also gives a more accurate phase.
#pragma once

#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

class MicroDecoder {
 public:
  // `fringes`: the estimator of the period with phase steps. Throws Error if fewer than two images of similar periods
  // code the axis, or if their periods do not distinguish all orders over `length_px`.
  MicroDecoder(const PatternSequence& sequence, Axis axis, const StepEstimator& fringes, int length_px);

  // Results of a row besides its orders, and buffers.
  struct Row {
    std::vector<float> change_turns;  // of the phase, by the images of the other periods
    std::vector<float> sigma_ratio;   // by which they reduce its sigma
    RowPrior* anchor = nullptr;
  };

  // Fills in the anchor, and what refine() needs. `samples` are rows of grey values of the stack's images.
  void find_orders(const RowPlan& plan, const float* const* samples, int width, InstructionSet set, Row& row) const;

  // Corrects a decoded row.
  void refine(const RowPlan& plan, int width, const Row& row, const RowOutput& out) const;

  // The estimator of the fringes, the images of further periods, and the tables of the search, as the kernels use them.
  struct Code {
    const StepEstimator* fringes = nullptr;
    std::vector<int> images;
    std::vector<float> ratio, shift_turns;  // first period / other period; phase at the projector's border
    int orders = 0;                         // candidates
    std::vector<float> cosine, sine;        // of the shift and of K turns of the first period, per image and order
  };

 private:
  Code code_;
};

}  // namespace fringeslam
