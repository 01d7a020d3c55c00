// SPDX-License-Identifier: Apache-2.0
// Separable filters with symmetric kernels, with the same bits on every instruction set. OpenCV's filters of float images
// fuse products and sums where the processor can.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/base/instruction_set.h"

namespace fringeslam {

// Continuation of an image beyond its border pixels: mirrored about their centres, or constant.
enum class FilterBorder { mirrored, replicated };

// Returns one half of a normalized Gaussian, from the centre on, truncated at `reach` sigma (in pixels).
std::vector<float> gaussian_half(double sigma, double reach = 4);

// The same for a point spread, also one below half a pixel, where whole pixels sample the bell too coarsely: its variance is
// sigma^2.
std::vector<float> point_spread_half(double sigma);

// Convolves the rows and columns of an image (8U, 16U or 32F, one channel) with a kernel of which half[k] is the weight
// of the pixels at distance k.
cv::Mat1f filtered(const cv::Mat& image, const std::vector<float>& half, FilterBorder border, InstructionSet set);

}  // namespace fringeslam
