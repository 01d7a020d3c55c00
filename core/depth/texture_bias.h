// SPDX-License-Identifier: Apache-2.0
// Bias of the projector coordinate beside texture (docs/method.md, section 4.1). A pixel measures the phase at the centroid of
// the light that its blur collects. Where the modulation B changes across the pixel, the centroid is not the pixel's center:
// for a point spread of variance s^2 it lies at s^2 grad(ln B), so that the coordinate u is too large by s^2 grad(ln B) . grad(u).
#pragma once

#include "core/base/instruction_set.h"

namespace fringeslam {

// A row of an image between its neighbors; beyond the border, the row itself.
struct ThreeRows {
  const float *above, *here, *below;
};

// Computes grad(ln B) . grad(u), 1/px, of a row, from central differences. An axis contributes nothing where u bends by more
// than half a projector pixel or a neighbor is missing, as at edges of surfaces; where ln B bends, the smallest difference counts,
// because light mixed at an edge beside the pixel does not reach it. The first and the last pixel are 0.
void texture_gradient_row(const ThreeRows& coordinate_px, const ThreeRows& modulation_dn, int width, float* gradient,
                          InstructionSet set);

}  // namespace fringeslam
