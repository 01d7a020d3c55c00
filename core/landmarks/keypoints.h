// SPDX-License-Identifier: Apache-2.0
// SIFT keypoints (METHOD S11) of the texture, with the 3D point that the sensor measured at each, and of the depth
// image; repeatable matching of descriptors by brute force, the oracle of any faster search (METHOD S18).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct KeypointOptions {
  int max_keypoints = 2500;
  double contrast_threshold = 0.003;  // of SIFT's difference of Gaussians, image scaled to [0, 1]
  double edge_threshold = 10;
  double pixel_sigma = 0.1;  // localisation of a keypoint of SIFT scale 1.6, px; grows with the scale
  int max_depth_keypoints = 600;
  double depth_contrast_threshold = 0.001;
  double depth_edge_threshold = 100;
  bool texture_halved = false;
  bool depth_halved = true;
  bool root_sift = true;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_keypoints", max_keypoints, {10, 100000}, "strongest keypoints that are kept");
    v.field("max_depth_keypoints", max_depth_keypoints, {10, 100000}, "strongest keypoints of the depth image");
    v.field("contrast_threshold", contrast_threshold, {1e-5, 1}, "SIFT contrast threshold");
    v.field("depth_contrast_threshold", depth_contrast_threshold, {1e-5, 1},
            "the same for the depth image, stretched over the depths that occur in it");
    v.field("depth_edge_threshold", depth_edge_threshold, {1, 1000},
            "the same for the depth image, whose corners lie on edges");
    v.field("texture_halved", texture_halved,
            "keypoints of the texture at half its resolution, in half of the time; fewer of them, and less well known");
    v.field("depth_halved", depth_halved,
            "keypoints of the depth image at half its resolution, in a quarter of the time");
    v.field("root_sift", root_sift, "descriptors compared by their overlap instead of their Euclidean distance");
    v.field("edge_threshold", edge_threshold, {1, 1000}, "SIFT edge threshold");
    v.field("pixel_sigma", pixel_sigma, {0.01, 10}, "localisation sigma of the finest keypoints, px");
  }
};

struct MatchOptions {
  double max_ratio = 0.8;  // Lowe's ratio of the nearest to the second nearest distance

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_ratio", max_ratio, {0.1, 1}, "largest ratio of nearest to second nearest descriptor distance");
  }
};

Keypoints detect_keypoints(const Frame& frame, const RigModel& rig, const PixelRays& rays,
                           const KeypointOptions& options);

// SIFT keypoints of a depth image of 255 levels, bright near: the rows of matrix A (thesis Table 1). SIFT sees the
// levels that occur, but for the hundredth that is darkest and the one that is brightest, stretched over all 256, so
// that a shallow scene has keypoints as well.
std::vector<DepthKeypoint> detect_depth_keypoints(const cv::Mat1f& levels, const KeypointOptions& options);

// Pairs that are each other's nearest descriptor and pass the ratio test, in the order of `current`.
std::vector<KeypointMatch> match_keypoints(const Keypoints& earlier, const Keypoints& current,
                                           const MatchOptions& options);

}  // namespace fringeslam
