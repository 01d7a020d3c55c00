// SPDX-License-Identifier: Apache-2.0
// The arithmetic of decoding for one row of pixels.
//
// Phases are in turns here, theta = phi / 2 pi in (-1/2, 1/2], and an absolute phase is t = theta + K.
#pragma once

#include <cstdint>
#include <vector>

#include "core/base/instruction_set.h"

namespace fringeslam {

// One fringe period: weights of the least-squares estimators of I', I'' cos phi and I'' sin phi. The last two
// give zero for equal samples, so they are applied to differences from the first sample.
struct StepEstimator {
  std::vector<int> images;  // indices into the stack
  std::vector<float> mean, cosine, sine;
  // Offset of the measured phase in turns over one turn of it, to be subtracted; empty: none.
  std::vector<float> correction_turns;
};

// A phase to count periods with: the sum of integer multiples of the groups' phases, which again is the phase of a
// fringe, of period 1 / sum(multiple / period). One period of its own, or the beat of several.
struct Rung {
  double period_px = 0;
  std::vector<int> multiples;  // one for each group
};

// What is the same for all rows.
struct RowPlan {
  std::vector<StepEstimator> groups;  // the last one is the finest, whose phase is the result
  std::vector<Rung> rungs;            // coarsest first, the last is the finest group; empty: no absolute phase by them
  bool anchored = false;              // absolute phase by RowAnchor
  double period_px = 0;               // finest
  int length_px = 0;                  // of the projector along the axis
  // Camera: variance of a grey value = constant + per_dn * max(I - offset, 0), DN^2.
  float noise_constant = 0, noise_per_dn = 0, offset_dn = 0;
  // Validity.
  float clip_dn = 0, min_modulation_dn = 0, min_data_modulation = 0, max_sigma_turns = 0;
  float max_order_failure = 0, max_residual_sigma = 0;
};

// Where the absolute phase must be: turns +- half_width, up to a normal error of sigma; wrong altogether with
// probability failure. NaN: not known.
struct RowAnchor {
  std::vector<float> turns, half_width, sigma, failure;
};

// One row of DecodedStack.
struct RowOutput {
  float *mean, *modulation, *wrapped_phase, *coordinate, *sigma, *confidence;
  int32_t* order;
};

// Buffers of one thread, reused from row to row.
struct RowScratch {
  std::vector<const float*> samples;  // of each image of the stack: the row's grey values
  std::vector<float> floats;
  std::vector<int32_t> masks;
  RowAnchor anchor;
};

void decode_row(const RowPlan& plan, int width, RowScratch& scratch, const RowOutput& out, InstructionSet set);

}  // namespace fringeslam
