// SPDX-License-Identifier: Apache-2.0
// Gaussian scale space (Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 3; Lindeberg,
// Scale-space theory, 1994). The first octave has twice the image's resolution, each following one half the resolution
// of the previous one; the blur increases from level to level.
#pragma once

#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

constexpr int kScalesPerOctave = 3, kLevels = kScalesPerOctave + 3;
constexpr double kFinestSigma = 1.6;  // of an octave's first level, in pixels of that octave

// Returns the sigma of a level in pixels of its octave; fractional levels are allowed, since keypoints lie between
// levels.
inline double level_sigma(double level) { return kFinestSigma * std::exp2(level / kScalesPerOctave); }

using Octave = std::array<cv::Mat1f, kLevels>;

// Computes the scale space of `image`; images less than 4 pixels across have no octaves. Pixel x of octave n lies at x
// 2^(n - 1) - 1/4 in the image: doubling preserves the image's corners, halving the centre of the first pixel.
std::vector<Octave> scale_space(const cv::Mat1b& image);
inline double pixel_of(int octave, double x) { return std::ldexp(x, octave - 1) - 0.25; }

// Convolves with a Gaussian truncated at 3.5 sigma; the image is mirrored about the centres of its border pixels.
cv::Mat1f blurred(const cv::Mat1f& image, double sigma);

}  // namespace fringeslam
