// SPDX-License-Identifier: Apache-2.0
// Scale-invariant keypoints and their descriptors (docs/method.md, section 5.2; Lowe, Distinctive image features from
// scale-invariant keypoints, 2004): extrema of differences of Gaussians in position and scale, located with sub-pixel
// and sub-level accuracy; dominant gradient orientations; gradient histograms over 4 x 4 cells in 8 directions.
//
// Descriptor gradients are differences of samples on a grid rotated by the keypoint's orientation, four samples per
// cell side, instead of the gradients of all pixels: the blurred level contains no finer detail, and the grid's
// weights are the same for all keypoints.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct SiftOptions {
  int max_keypoints = 2500;           // strongest keypoints kept
  double contrast_threshold = 0.003;  // compared with kScalesPerOctave x contrast, image in [0, 1]
  double edge_threshold = 10;         // largest ratio of principal curvatures
};

struct SiftKeypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma = 0;      // sigma of the Gaussian at the detection scale, px
  double angle_rad = 0;  // dominant gradient orientation, from x towards y, in [0, 2 pi)
  double strength = 0;   // contrast of the extremum, image in [0, 1]
};

struct SiftFeatures {
  std::vector<SiftKeypoint> keypoints;  // strongest first; one entry for each orientation
  cv::Mat1f descriptors;                // N x 128, unit length; empty unless requested
};

enum class Describe { no, yes };

// Detects and, on request, describes the keypoints of `image`; the result does not depend on the number of threads.
SiftFeatures sift(const cv::Mat1b& image, const SiftOptions& options, Describe describe);

}  // namespace fringeslam
