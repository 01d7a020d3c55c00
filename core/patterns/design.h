// SPDX-License-Identifier: Apache-2.0
// A pattern sequence from what one wants of it, and how its images are handed to a projector.
#pragma once

#include <string>

#include "core/patterns/patterns.h"

namespace fringeslam {

enum class GrayCode {
  none,
  plain,         // the bits of the finest fringe period's number
  complementary  // and one more of half a period, which leaves no cell's edge undecided
};

struct SequenceDesign {
  int width = 0, height = 0;  // of the projector, px
  bool columns = true, rows = false;
  std::vector<double> periods_px = {};
  int steps = 3;
  GrayCode gray = GrayCode::none;
  bool gray_inverted = false;  // every bit a second time, inverted
  bool white_black = false;    // a white and a black image
  int ramp_levels = 0;         // equally spaced flat levels from black to white
  int bits = 8;
  bool dithered = false;
};

// Fringes period by period, then the Gray code, coarsest bit first; columns before rows; flat images last.
// Throws Error when nothing is asked for or a Gray code has no fringe to number.
PatternSequence design_sequence(const SequenceDesign& design);

// Three grey images as one colour image (OpenCV's BGR) for a projector in black-and-white mode, which shows its
// channels one after the other as grey images [C III.A]. `order`, such as "RGB": the channel of each image.
cv::Mat3b packed_image(const std::vector<cv::Mat1b>& images, const std::string& order);

}  // namespace fringeslam
