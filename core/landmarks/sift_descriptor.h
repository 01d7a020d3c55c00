// SPDX-License-Identifier: Apache-2.0
// Directions and descriptors of keypoints; sift.h says what they are.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

constexpr int kDescriptorCells = 4, kDescriptorDirections = 8,
              kDescriptorSize = kDescriptorCells * kDescriptorCells * kDescriptorDirections;

// Where a keypoint is in a level of its octave, the level's pixels.
struct LevelPlace {
  float x = 0, y = 0, sigma = 0;
};

// Directions of most gradients around, those of at least 0.8 of the most, radians from x towards y from 0 to 2 pi.
std::vector<float> directions_of(const cv::Mat1f& level, const LevelPlace& place);

// Unit length, no component above 0.2 before it is made so for good (Lowe, section 6.1). Cell by cell, x running
// faster, direction fastest; all in the keypoint's own directions.
void describe_place(const cv::Mat1f& level, const LevelPlace& place, float direction, float* descriptor);

}  // namespace fringeslam
