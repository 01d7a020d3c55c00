// SPDX-License-Identifier: Apache-2.0
// Decoding kernels for one row of pixels.
//
// Phases are in turns: theta = phi / 2 pi in (-1/2, 1/2]; an absolute phase is t = theta + K.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/instruction_set.h"

namespace fringeslam {

// Limits, for which select_groups() and modulated_code() throw.
constexpr std::size_t kMaxGroups = 16, kMaxSteps = 64;

// Least-squares estimator of one fringe period: weights of the estimates of I', I'' cos phi and I'' sin phi. The
// weights of the last two sum to zero, so they are applied to differences from the first sample.
struct StepEstimator {
  std::vector<int> images;  // indices into the stack
  std::vector<float> mean, cosine, sine;
  // The phase shifts, turns, and the period: the estimator of each pixel in motion.
  std::vector<float> shift_turns;
  float period_px = 0;
  // Offset to be subtracted from the measured phase, in turns, tabulated over one turn of measured phase; empty: none.
  std::vector<float> correction_turns;
  float error_turns2 = 0;  // variance of what the correction leaves
};

// Unwrapping level: a linear combination of the groups' phases with integer multiples, which is the phase of a fringe
// with period 1 / sum(multiple / period): a single period, or a beat of several.
struct UnwrappingLevel {
  double period_px = 0;
  std::vector<int> multiples;  // one per group
};

// Decoding parameters that are the same for all rows.
struct RowPlan {
  std::vector<StepEstimator> groups;               // coarsest first; the last, finest one gives the result
  std::vector<UnwrappingLevel> unwrapping_levels;  // coarsest first, the last is the finest group; empty: not used
  bool anchored = false;                           // absolute phase from RowPrior
  double period_px = 0;                            // finest
  int length_px = 0;                               // of the projector along the coded axis
  // Camera noise: variance of a grey value = constant + per_dn * max(I - offset, 0), DN^2.
  float noise_constant = 0, noise_per_dn = 0, offset_dn = 0;
  // Validity.
  float clip_dn = 0, min_modulation_dn = 0, min_data_modulation = 0, max_sigma_turns = 0;
  float max_order_failure = 0, max_residual_sigma = 0;
};

// Prior of the absolute phase: within turns +- half_width, with a normal error of sigma; wrong with probability
// failure. NaN: unknown.
struct RowPrior {
  std::vector<float> turns, half_width, sigma, failure;
};

// One row of DecodedStack.
struct RowOutput {
  float *mean, *modulation, *wrapped_phase, *coordinate, *sigma, *confidence;
  int32_t* order;
};

// Per-thread buffers, reused for all rows.
struct RowScratch {
  std::vector<const float*> samples;  // grey values of the row, for each image of the stack
  // Drift of the projector coordinate of each image, px; NaN: no sample. Empty: at rest.
  std::vector<const float*> drift_px;
  // Variance of each image's grey values, DN^2. Empty: from the plan's noise model.
  std::vector<const float*> variances;
  std::vector<float> floats;
  std::vector<int32_t> masks;
  RowPrior anchor;
};

void decode_row(const RowPlan& plan, int width, RowScratch& scratch, const RowOutput& out, InstructionSet set);

}  // namespace fringeslam
