// SPDX-License-Identifier: Apache-2.0
// Sub-pixel corners of a checkerboard by fitting what one looks like: two straight edges that cross, blurred,
//
//   I(x) = m + g.(x - c) + k E(n_1.(x - c)) E(n_2.(x - c)),   E = erf(./(sqrt 2 s)) averaged over a pixel's width,
//
// over all pixels round the corner: several times finer than where gradients point.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

// Moves corners (row by row, `columns` in a row, within a pixel or so of the truth) to the fits' centres; those whose
// fit fails or strays stay where they are.
void refine_saddles(const cv::Mat1f& image, int columns, std::vector<cv::Point2f>& corners);

}  // namespace fringeslam
