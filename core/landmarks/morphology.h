// SPDX-License-Identifier: Apache-2.0
// Morphology of edge images of any size (docs/method.md, section 5.1; thesis 3.1.3 and 3.1.4); pixels beyond the
// border are 0.
#pragma once

#include "core/landmarks/bit_image.h"

namespace fringeslam {

// Dilates by the 3x3 square (thesis eq. 1, Fig. 3-4).
BitImage dilated(const BitImage& image);

// Returns the 8-connected components of `mask` that contain a seed (morphological reconstruction by dilation).
BitImage reconstructed(const BitImage& seeds, const BitImage& mask);

// Returns the number of 8-connected components minus the number of holes.
int euler_number(const BitImage& image);

struct Closing {
  BitImage image;
  int dilations = 0;
};
// Dilates up to `most` times until gaps are closed, and not more often: joining components or closing a ring lowers
// the Euler number, and the smallest number of dilations with the lowest Euler number is used.
Closing close_gaps(const BitImage& image, int most);

// Thins to lines one pixel wide (thesis eq. 2): A (x) {B1 … B8}, Golay's L and its rotations by 45 degrees, applied in
// turn until nothing changes; then remaining 2x2 blocks are reduced. Components and holes are preserved. A block
// remains where four lines meet at its four corners.
BitImage thinned(BitImage image);

// Deletes pixels with no or one 8-neighbour, repeatedly, until every pixel has two or more (thesis 3.1.4). The run
// time is proportional to the number of edge pixels.
BitImage remove_open_lines(BitImage image);

}  // namespace fringeslam
