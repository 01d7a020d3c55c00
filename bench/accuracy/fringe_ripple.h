// SPDX-License-Identifier: Apache-2.0
// Ripple that motion leaves in decoded phase, and binomial self-compensation as a method to compare with.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam::bench {

// Phase of four steps decoded as if the scene were at rest: images first, …, first + 3, image k with the shift k pi/2.
// H x W, rad, (-pi, pi].
cv::Mat1f four_step_phase(const std::vector<cv::Mat1f>& images, size_t first);

// Binomial self-compensation of order K (Zhang, Zhu and Liu, ECCV 2024, eq. for the phase sequence): the sum of the phases
// of K + 1 consecutive four-step windows, which starts at image `first` and uses K + 4 images, with binomial weights. The
// phases are added as differences from that of the middle window. H x W, rad, (-pi, pi].
cv::Mat1f binomial_phase(const std::vector<cv::Mat1f>& images, size_t first, int order);

// Amplitude (cosine, sine) of cos and sin of `harmonic` times the phase in each tile where at least 90 % of the pixels
// are in `mask`: least squares over these and a cubic polynomial of the pixel's position. Tiles whose remaining residual
// exceeds 0.15 rad contain a surface edge and are NaN. Tiles are in row-major order, and the same for equal sizes.
std::vector<cv::Vec2d> tile_ripple(const cv::Mat1f& wrapped_phase, const cv::Mat1b& mask, cv::Size tile, int harmonic);

}  // namespace fringeslam::bench
