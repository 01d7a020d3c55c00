// SPDX-License-Identifier: Apache-2.0
// Selects the images used for decoding and builds the phase estimator of a period.
#pragma once

#include <vector>

#include "core/decode/decode.h"
#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

// Standard deviation of a phase due to the 256 levels of the projector; decisions on fringe orders allow for it.
constexpr double kProjectorSigma_rad = 0.0037;

// Returns the length of the projector's image along an axis, px.
inline int length_of(const PatternSequence& sequence, Axis axis) {
  return axis == Axis::columns ? sequence.width : sequence.height;
}

// Returns the fringe groups of an axis, coarsest first, reduced to the number of steps selected by the options.
std::vector<FringeGroup> select_groups(const PatternSequence& sequence, Axis axis, const DecodeOptions& options);

// Returns the least-squares estimator over (1, cos delta_k, sin delta_k).
StepEstimator least_squares(const FringeGroup& group);

// Returns the rig's phase correction as a table over the measured phase: measured minus true phase, turns. Empty if it
// belongs to another number of steps or the steps are not equally spaced.
std::vector<float> correction_of(const FringeGroup& group, const PhaseCorrection& correction);

// Equally spaced shifts near those of a stack in motion, whose drift changes them, or of one that anticipates a motion. Errors of
// the projector's response are corrected as for these shifts.
struct EvenShifts {
  std::vector<double> shifts_rad;
  double off_rad = 0;  // largest distance of the given shifts from them

  // False if correction would do harm.
  bool near() const;
  // The mean square of what correction leaves, relative to that of the correction.
  double remaining() const;
};
EvenShifts nearest_even(std::vector<double> shifts_rad);

}  // namespace fringeslam
