// SPDX-License-Identifier: Apache-2.0
// Sequences of unwrapping levels, from a phase that covers the projector to the finest one (docs/method.md, section
// 3.2).
#pragma once

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

// Noise of the fraction from which the order of `fine` follows, in turns, relative to that of each phase.
double step_noise(const UnwrappingLevel& coarse, const UnwrappingLevel& fine);

// Returns the periods themselves, coarsest first. Throws Error if the coarsest does not cover `length_px`.
std::vector<UnwrappingLevel> multifrequency_levels(const std::vector<FringeGroup>& groups, int length_px);

// Forms the beats of any two periods, those of neighbouring beats, and so on, and returns levels from one that covers
// `length_px` down to the finest period: those whose least certain order tolerates the most phase noise. Throws Error if no
// beat covers `length_px`.
std::vector<UnwrappingLevel> heterodyne_levels(const std::vector<FringeGroup>& groups, int length_px);

}  // namespace fringeslam
