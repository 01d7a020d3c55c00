// SPDX-License-Identifier: Apache-2.0
// Edges of a depth image (docs/method.md, section 5.1; thesis 3.1.2). The strength of an edge is the height, in the
// image's levels, of the ideal step that would cause the same response, for every operator. The input must not contain
// NaN: fill pixels without depth first.
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "core/landmarks/bit_image.h"
#include "core/types/options.h"

namespace fringeslam {

// Gradient of each pixel, H x W, in levels: an ideal step at the pixel yields its height.
struct Gradient {
  cv::Mat1f x, y;
};

// Prewitt gradient: mean of three central differences; Roberts gradient: cross of two diagonal differences.
Gradient prewitt_gradient(const cv::Mat1f& levels);
Gradient roberts_gradient(const cv::Mat1f& levels);

// Deriche gradient of the given rows (R. Deriche, Using Canny's criteria to derive a recursively implemented optimal
// edge detector, IJCV 1 (1987)): smoothing by k (alpha |n| + 1) exp(-alpha |n|) along one axis and differentiation by
// -c n exp(-alpha |n|) along the other, each by a causal and an anticausal second-order recursion. Border values are
// replicated. The gradient of a range of rows differs by less than 1e-5 of the levels from that of the whole image.
Gradient deriche_gradient(const cv::Mat1f& levels, double alpha, cv::Range rows = cv::Range::all());

// Canny's non-maximum suppression and hysteresis: sets pixels whose gradient magnitude is at least `low` and at least
// that of both neighbours interpolated one pixel along the gradient, and that are connected through such pixels to one
// of at least `high`.
BitImage ridges(const Gradient& gradient, double low, double high);

// Sets zero crossings of the Laplacian of a Gaussian of `sigma` px whose slope is at least that of a step of
// `threshold`.
BitImage log_edges(const cv::Mat1f& levels, double sigma, double threshold);

enum class EdgeDetector { canny_deriche, prewitt, roberts, log };

constexpr auto choices(EdgeDetector) {
  using enum EdgeDetector;
  return std::to_array<Choice<EdgeDetector>>(
      {{canny_deriche, "canny_deriche"}, {prewitt, "prewitt"}, {roberts, "roberts"}, {log, "log"}});
}

BitImage detect_edges(const cv::Mat1f& levels, EdgeDetector detector, double alpha, double low, double high);

}  // namespace fringeslam
