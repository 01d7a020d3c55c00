// SPDX-License-Identifier: Apache-2.0
// Scale-invariant keypoints and their descriptors (METHOD S11; Lowe, Distinctive image features from scale-invariant
// keypoints, 2004): extrema of differences of Gaussians over place and scale, located between pixels and levels; the
// directions that most gradients around have; histograms of gradients over 4 x 4 cells in 8 directions.
//
// A descriptor's gradients are differences of samples of the level on a grid turned by the keypoint's direction, four
// to a cell's side, and not those of all pixels there: the level holds no more detail than that, and the grid's weights
// are the same for all keypoints.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct SiftOptions {
  int max_keypoints = 2500;           // the strongest
  double contrast_threshold = 0.003;  // of the differences, for an image from 0 to 1 and one level an octave
  double edge_threshold = 10;         // largest ratio of the principal curvatures
};

struct SiftKeypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma = 0;      // of the Gaussian at whose scale it was found, px
  double angle_rad = 0;  // of the direction of most gradients, from x towards y; 0 to 2 pi
  double strength = 0;   // contrast of the extremum, image from 0 to 1
};

struct SiftFeatures {
  std::vector<SiftKeypoint> keypoints;  // the strongest first; one of several directions for each of them
  cv::Mat1f descriptors;                // N x 128, unit length; empty when not asked for
};

enum class Describe { no, yes };

// The same bits with any number of threads.
SiftFeatures sift(const cv::Mat1b& image, const SiftOptions& options, Describe describe);

}  // namespace fringeslam
