// SPDX-License-Identifier: Apache-2.0
// Morphology of edge images (METHOD S8-S10; thesis 3.1.3 and 3.1.4). All sizes; pixels beyond the border are 0.
#pragma once

#include "core/landmarks/bit_image.h"

namespace fringeslam {

// A (+) B with B the 3x3 square (thesis eq. 1, Fig. 3-4).
BitImage dilated(const BitImage& image);

// The mask's 8-connected components that hold a seed (morphological reconstruction by dilation).
BitImage reconstructed(const BitImage& seeds, const BitImage& mask);

// Components less holes, of 8-connected sets.
int euler_number(const BitImage& image);

struct Closing {
  BitImage image;
  int dilations = 0;
};
// Dilated until the gaps are closed that `most` dilations can close, and not once more: to join what was apart, or to
// close a ring, lowers the Euler number, and the least number of dilations at which it is lowest is taken.
Closing dilated_until_closed(const BitImage& image, int most);

// Thins to lines one pixel wide (thesis eq. 2): A (x) {B1 … B8}, Golay's L and its rotations by 45 degrees, in turn
// until nothing changes; then what is left of blocks of 2x2. Components and holes stay. A block remains where four
// lines meet in its four corners.
BitImage thinned(BitImage image);

// Deletes pixels without a neighbour among eight, and those with a single one, from which it goes on; until every
// pixel has two neighbours or more (thesis 3.1.4). Time is proportional to the edge pixels.
BitImage without_loose_ends(BitImage image);

}  // namespace fringeslam
