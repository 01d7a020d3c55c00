// SPDX-License-Identifier: Apache-2.0
// Ensembles of codings (Gupta et al., CVPR 2011; docs/method.md, section 3.2). Light between surfaces, below surfaces and
// blur disturb different codings at different pixels, so a coordinate in which two of them agree is correct.
#pragma once

#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"

namespace fringeslam {

// Images of a sequence that may determine coordinates by themselves.
struct EnsembleMember {
  Unwrapping method = Unwrapping::multifrequency;
  std::vector<bool> images;  // one per pattern
};

// Returns all combinations of a method and its images that the patterns of an axis may support, the most accurate first:
// fringes, then each Gray code with the fringes whose orders it gives.
std::vector<EnsembleMember> possible_members(const PatternSequence& sequence, Axis axis);

// Reduces `members`, decoded from the same stack, to the coordinates in which at least two agree within `most_sigmas` of
// their noise and a quarter of the finest period. If as many others agree in another coordinate, there is none. Where they
// differ by more than their noise, sigma includes the difference. The result has the period of the first member.
DecodedStack agreement_of(const std::vector<DecodedStack>& members, double most_sigmas);

}  // namespace fringeslam
