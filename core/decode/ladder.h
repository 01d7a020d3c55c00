// SPDX-License-Identifier: Apache-2.0
// The ladders of phases from one that covers the projector down to the finest (METHOD S3).
#pragma once

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

// Each period itself, coarsest first. Throws Error when the coarsest does not cover `length_px`.
std::vector<Rung> multifrequency_ladder(const std::vector<FringeGroup>& groups, int length_px);

// Beats of neighbouring periods, beats of these, and so on, up to the first that covers `length_px`; then down again
// along the finest of each level. Throws Error when none does.
std::vector<Rung> heterodyne_ladder(const std::vector<FringeGroup>& groups, int length_px);

}  // namespace fringeslam
