// SPDX-License-Identifier: Apache-2.0
// Refines checkerboard corners to sub-pixel accuracy by fitting a model of two blurred crossing straight edges,
//
//   I(x) = m + g.(x - c) + k E(n_1.(x - c)) E(n_2.(x - c)),   E = erf(./(sqrt 2 s)) averaged over a pixel's width,
//
// to all pixels around the corner; several times more accurate than gradient-based refinement.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

// Moves the corners (row by row, `columns` per row, initial errors up to about a pixel) to the fitted centres; a corner
// whose fit fails or moves too far keeps its position.
void refine_saddle_points(const cv::Mat1f& image, int columns, std::vector<cv::Point2f>& corners);

}  // namespace fringeslam
