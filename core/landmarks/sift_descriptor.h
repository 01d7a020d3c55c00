// SPDX-License-Identifier: Apache-2.0
// Orientations and descriptors of keypoints; see sift.h.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

constexpr int kDescriptorCells = 4, kDescriptorDirections = 8,
              kDescriptorSize = kDescriptorCells * kDescriptorCells * kDescriptorDirections;

// Position and sigma of a keypoint in its level, in the level's pixels.
struct LevelPosition {
  float x = 0, y = 0, sigma = 0;
};

// Returns the dominant gradient orientations, those with at least 0.8 of the largest peak, in radians from x towards
// y, in [0, 2 pi).
std::vector<float> dominant_orientations(const cv::Mat1f& level, const LevelPosition& place);

// Computes a descriptor of unit length, with components clipped at 0.2 before the final normalisation (Lowe, section
// 6.1). Order: cell row, cell column, direction (fastest); all relative to the keypoint's orientation.
void compute_descriptor(const cv::Mat1f& level, const LevelPosition& place, float direction, float* descriptor);

}  // namespace fringeslam
