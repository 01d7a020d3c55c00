// SPDX-License-Identifier: Apache-2.0
// Gaussian scale space (Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 3; Lindeberg,
// Scale-space theory, 1994): octaves of an image at half the resolution of the one before, the first at twice the
// image's own, each blurred ever more.
#pragma once

#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

constexpr int kScalesPerOctave = 3, kLevels = kScalesPerOctave + 3;
constexpr double kFinestSigma = 1.6;  // of an octave's first level, its own pixels

// Of a level of an octave, its own pixels; levels in between are none of the images, but keypoints lie there.
inline double level_sigma(double level) { return kFinestSigma * std::exp2(level / kScalesPerOctave); }

using Octave = std::array<cv::Mat1f, kLevels>;

// Pixel x of octave n is at x 2^(n - 1) - 1/4 of the image: doubling keeps the image's corners where they are, halving
// the first pixel's centre. Of images of less than 4 pixels across there are no octaves.
std::vector<Octave> scale_space(const cv::Mat1b& image);
inline double pixel_of(int octave, double x) { return std::ldexp(x, octave - 1) - 0.25; }

// Convolved with a Gaussian that is cut off at 3.5 sigma; mirrored about the centres of the pixels on the border.
cv::Mat1f blurred(const cv::Mat1f& image, double sigma);

}  // namespace fringeslam
