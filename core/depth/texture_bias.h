// SPDX-License-Identifier: Apache-2.0
// Bias of the projector coordinate beside texture (docs/method.md, section 4.1). A pixel measures the phase at the centroid of
// the light that its blur collects. Where the modulation B changes across the pixel, the centroid is not the pixel's center:
// for a point spread of variance s^2 it lies at s^2 grad(ln B), so that the coordinate u is too large by s^2 grad(ln B) . grad(u).
#pragma once

#include "core/base/instruction_set.h"

namespace fringeslam {

// A row of an image between its neighbors.
struct ThreeRows {
  const float *above, *here, *below;
};

struct TextureRows {
  ThreeRows coordinate_px, modulation_dn;
  const float* sigma_px;  // of the coordinate
  float
      phase_per_px;  // of the fringes, rad per projector px: the relative noise of the modulation is that of the phase
};

// Computes from central differences, for each pixel of a row, `gradient` = grad(ln B) . grad(u), 1/px, and `noise`, its variance
// relative to that of the coordinate. An axis contributes nothing where u bends by more than half a projector pixel or a neighbor
// is missing, as at edges of surfaces. Where ln B bends beyond its noise, the smaller difference counts, because light mixed at an
// edge beside the pixel does not reach it. Both are 0 at the first and the last pixel.
void texture_gradient_row(const TextureRows& rows, int width, float* gradient, float* noise, InstructionSet set);

}  // namespace fringeslam
