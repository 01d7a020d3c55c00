// SPDX-License-Identifier: Apache-2.0
// Modulated phase shifting (Chen, Seidel and Lensch, CVPR 2008; docs/method.md, section 3.2): low frequencies on
// high-frequency carriers.
//
// A product of cosines with periods p and c is the sum of two fringes of half its amplitude, with the periods
// c p / (p + c) and c p / (p - c) near the carrier's:
//
//   cos(Phi + delta) cos(Phi_c + delta_c) = 1/2 cos(Phi_c + Phi + delta_c + delta) + 1/2 cos(Phi_c - Phi + delta_c - delta)
//
// All images contain high frequencies only, so indirect light contributes the same constant to each of them. The
// images of all combinations of the shifts determine both phases; their difference is that of a fringe with period p / 2.
#pragma once

#include <vector>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

struct ModulatedCode {
  // Two per product, then the fringes of the carrier's period, if the sequence has any; the last group gives the result.
  std::vector<FringeGroup> groups;
  std::vector<UnwrappingLevel> levels;  // coarsest first
};

// Returns the fringes that the products of one axis consist of and the sequence of levels that unwraps the last one over
// `length_px`. Throws Error if there are no products, if their shifts do not separate both fringes, or if no product has
// at least twice (with fringes of the carrier: once) the length as its period.
ModulatedCode modulated_code(const PatternSequence& sequence, Axis axis, int length_px);

}  // namespace fringeslam
