// SPDX-License-Identifier: Apache-2.0
// Whether the images of a sequence show the patterns that were asked for, told from the images alone: a projector or a
// camera that drops, repeats or shifts an image delivers one that looks as good as any.
//
// Each sequence is taken with two more images, all white W and all black K. A pixel that tells them apart sees every
// pattern between the two: (I - K) / (W - K) is the pattern's level v at the pixel's projector coordinate. So
//
//   flat    v is the pattern's level;
//   gray    v is 0 or 1, and where a bit and its inverse are both shown they are opposite;
//   fringe  the mean of the N images of one period is the same at all pixels and for all periods; with more than three
//           images a cosine goes through all of them; and of two periods the finer's phase is the coarser's, times
//           their ratio, up to whole turns.
//
// An image of another pattern breaks one of these at most pixels. A projector whose light grows as the gamma'th power
// of the grey value shows fringes that are no cosines, and their mean is not 1/2 but (with s the share of the light)
//
//   mean over a turn of (1/2 + cos(s)/2)^gamma = Gamma(2 gamma + 1) / (4^gamma Gamma(gamma + 1)^2).
//
// So the mean tells the gamma, and levels are made linear with it before phases are compared.
#pragma once

#include <string>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

struct SequenceCheckOptions {
  double min_contrast_dn = 12;     // between white and black, of pixels that can tell
  double tolerance = 0.12;         // of a level that should be 0 or 1
  double mean_tolerance = 0.08;    // of the mean of a period's images
  double cosine_tolerance = 0.15;  // root of the summed squares of what a cosine leaves of more than three images
  double max_outliers = 0.25;      // share of such pixels that may contradict: edges, interreflection, gloss
  double min_pixels = 0.02;        // share of the image that must be able to tell
};

struct SequenceVerdict {
  bool good = false;
  std::string reason;  // of what is not good, a clause that names the image
  double gamma = 1;    // of the projector's response as the fringes' mean tells it; 1 without fringes of whole turns
};

// The gamma whose fringes have this mean level. Throws Error below 0.25 (gamma 4.7) and above 0.75 (0.25).
double gamma_of_mean(double mean);

// `images`: of `sequence`, in its order; white and black: with all of the projector's pixels on and off.
SequenceVerdict check_sequence(const PatternSequence& sequence, const std::vector<cv::Mat>& images,
                               const cv::Mat& white, const cv::Mat& black, const SequenceCheckOptions& options = {});

}  // namespace fringeslam
