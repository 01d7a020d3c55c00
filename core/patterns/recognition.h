// SPDX-License-Identifier: Apache-2.0
// Recognizes the pattern that an image for a projector shows: a flat level, a bit of a reflected Gray code, or a cosine.
// See docs/method.md, section 2.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pattern_sequence.h"

namespace fringeslam {

struct RecognizedPattern {
  Pattern pattern;
  double dark = 0, bright = 1;  // levels between which the pattern varies, in parts of full scale; equal: flat
};

// Recognizes an image of the projector's size: CV_8UC1, CV_16UC1 or CV_32FC1 with levels from 0 to 1. Parameters are the
// simplest that agree with the levels: whole numbers, a whole number of periods, or few decimals. Throws
// Error if the size differs, or if the image shows none of these patterns; the message then names the best cosine and
// its residual, and says whether a monotone function of a cosine fits. A cosine of 4 px whose pixels have two levels is
// taken for a Gray bit with cells of 1 px.
RecognizedPattern recognize_pattern(const cv::Mat& image, const cv::Size& projector);

// Makes patterns that were recognized one by one a sequence:
//   - Fringes of one axis whose periods agree within a thousandth get the same period, that of a described pattern if
//     there is one. The phase in the middle of the image is kept. Fringes with fewer than three shifts become `extra`.
//     Equally spaced shifts of the others become exactly so.
//   - Cells of the Gray bits of one axis become a common width times powers of two, if one width explains all images:
//     that of described bits or of a fringe period times a power of two, otherwise the simplest.
//   - Flat levels become parts of the range between the darkest and the brightest level of all patterns, unless all
//     patterns are flat.
// `described`: the patterns of the sequence that were not recognized.
void reconcile_patterns(std::vector<RecognizedPattern>& recognized, const std::vector<Pattern>& described,
                        const cv::Size& projector);

}  // namespace fringeslam
