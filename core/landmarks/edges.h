// SPDX-License-Identifier: Apache-2.0
// Edges of a depth image (METHOD S7; thesis 3.1.2). The strength of an edge is the step that would cause it, in the
// image's own levels, whichever operator measured it. NaN is not allowed: fill what has no depth first.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/landmarks/bit_image.h"

namespace fringeslam {

// Gradient of each pixel, H x W, in levels of an ideal step across the pixel.
struct Gradient {
  cv::Mat1f x, y;
};

// The mean of three central differences, or the cross of two diagonal differences.
Gradient prewitt_gradient(const cv::Mat1f& levels);
Gradient roberts_gradient(const cv::Mat1f& levels);

// R. Deriche, Using Canny's criteria to derive a recursively implemented optimal edge detector, IJCV 1 (1987):
// smoothing by k (alpha |n| + 1) exp(-alpha |n|) along one axis, derivative by -c n exp(-alpha |n|) along the other,
// each by a causal and an anticausal recursion of second order. The border's values go on beyond it. Of the given rows,
// which differ by less than 1e-5 of the levels from what they are in the gradient of all.
Gradient deriche_gradient(const cv::Mat1f& levels, double alpha, cv::Range rows = cv::Range::all());

// Set where the gradient's length is at least `low`, not exceeded by either of the two values one pixel to both sides
// along the gradient (Canny's non-maximum suppression), and linked by such pixels to one of at least `high`.
BitImage ridges(const Gradient& gradient, double low, double high);

// Zero crossings of the Laplacian of a Gaussian of `sigma` px whose slope is that of a step of at least `threshold`.
BitImage log_edges(const cv::Mat1f& levels, double sigma, double threshold);

// The names of the four detectors.
const std::vector<std::string>& edge_detectors();

BitImage detect_edges(const cv::Mat1f& levels, const std::string& detector, double alpha, double low, double high);

}  // namespace fringeslam
