// SPDX-License-Identifier: Apache-2.0
// Gray codes whose bits have neither narrow nor wide stripes: codes with long runs (Goddyn and Gvozdjak, 2003), as Gupta et
// al. (CVPR 2011) project them to resist both blur and light between surfaces.
#pragma once

#include <vector>

namespace fringeslam {

constexpr int kMostLongRunBits = 14;

// Returns the 2^bits words of a cyclic Gray code in the order of the cells; its first bit is the highest. Of ten bits, each
// keeps its value for 7 to 18 cells. Throws Error unless 1 <= bits <= 14.
const std::vector<unsigned>& long_run_code(int bits);

}  // namespace fringeslam
