// SPDX-License-Identifier: Apache-2.0
// Whether the images of a sequence show the patterns that were asked for, told from the images alone: a projector or a
// camera that drops, repeats or shifts an image delivers one that looks as good as any.
//
// Each sequence is taken with two more images, all white W and all black K. A pixel that tells them apart sees every
// pattern between the two: (I - K) / (W - K) is the pattern's level v at the pixel's projector coordinate. So
//
//   flat    v is the pattern's level;
//   gray    v is 0 or 1, and where a bit and its inverse are both shown they are opposite;
//   fringe  the N images of one period have, with v = 1/2 + c/2 cos(Phi + delta), mean 1/2, for fringes of whole turns;
//           and of two periods the finer's phase is the coarser's, times their ratio, up to whole turns.
//
// An image of another pattern breaks one of these at most pixels. Where a projector's response is not linear the mean
// is not 1/2, but it is the same for all periods that are long against the blur: the tolerance leaves room for that.
#pragma once

#include <string>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

struct SequenceCheckOptions {
  double min_contrast_dn = 12;  // between white and black, of pixels that can tell
  double tolerance = 0.12;      // of a level
  double max_outliers = 0.25;   // share of such pixels that may contradict: edges, interreflection, gloss
  double min_pixels = 0.02;     // share of the image that must be able to tell
};

struct SequenceVerdict {
  bool good = false;
  std::string reason;  // of what is not good, a clause that names the image
};

// `images`: of `sequence`, in its order; white and black: with all of the projector's pixels on and off.
SequenceVerdict check_sequence(const PatternSequence& sequence, const std::vector<cv::Mat>& images,
                               const cv::Mat& white, const cv::Mat& black, const SequenceCheckOptions& options = {});

}  // namespace fringeslam
