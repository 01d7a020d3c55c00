// SPDX-License-Identifier: Apache-2.0
// Bias of the projector coordinate beside texture (docs/method.md, section 4.1). A pixel measures the phase at the centroid of
// the light that its blur collects. Where the modulation B changes across the pixel, the centroid is not the pixel's center:
// for a point spread of variance s^2 it lies at s^2 grad(ln B), so that the coordinate u is too large by s^2 grad(ln B) . grad(u).
#pragma once

#include <array>

#include "core/base/instruction_set.h"

namespace fringeslam {

// A row of an image between two rows on either side: [2] is the row itself.
using FiveRows = std::array<const float*, 5>;

struct TextureRows {
  FiveRows coordinate_px, modulation_dn;
  const float* sigma_px;  // of the coordinate
  // Phase of the fringes, rad per projector px: the relative noise of the modulation is that of the phase.
  float phase_per_px;
};

// Pixels at the border without a gradient.
constexpr int kTextureBorder = 2;

// Computes from central differences, for each pixel of a row, `gradient` = grad(ln B) . grad(u), 1/px, and `noise`, its variance
// relative to that of the coordinate. An axis contributes nothing where one of the two neighbors on either side is missing or u
// bends beyond its noise, as at edges of surfaces and of shadows: light mixed at an edge does not reach the pixels beside it.
// The differences are linear, so that their mean over a texture is 0, whatever its shape. Both are 0 at the border.
void texture_gradient_row(const TextureRows& rows, int width, float* gradient, float* noise, InstructionSet set);

}  // namespace fringeslam
