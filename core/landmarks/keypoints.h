// SPDX-License-Identifier: Apache-2.0
// SIFT keypoints of the texture (METHOD S11) with the 3D point that the sensor measured at each, and
// repeatable matching of their descriptors (METHOD S18; brute force, the oracle of any faster search).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct KeypointOptions {
  int max_keypoints = 1500;
  double contrast_threshold = 0.01;  // of SIFT's difference of Gaussians, image scaled to [0, 1]
  double edge_threshold = 10;
  double pixel_sigma = 0.1;  // localisation of a keypoint of SIFT scale 1.6, px; grows with the scale

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_keypoints", max_keypoints, {10, 100000}, "strongest keypoints that are kept");
    v.field("contrast_threshold", contrast_threshold, {1e-5, 1}, "SIFT contrast threshold");
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

struct Keypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double scale = 0;  // SIFT's sigma, px
  double angle_rad = 0;
  Eigen::Vector3d point_m = Eigen::Vector3d::Zero();  // camera frame
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();
};

struct Keypoints {
  std::vector<Keypoint> keypoints;  // only those where a depth was measured
  cv::Mat1f descriptors;            // N x 128, unit length
  int detected = 0;                 // with and without depth
};

struct Match {
  int previous = 0, current = 0;  // indices
  double distance = 0, ratio = 0;
};

Keypoints detect_keypoints(const Frame& frame, const RigModel& rig, const PixelRays& rays,
                           const KeypointOptions& options);

// Pairs that are each other's nearest descriptor and pass the ratio test, in the order of `current`.
std::vector<Match> match_keypoints(const Keypoints& previous, const Keypoints& current, const MatchOptions& options);

}  // namespace fringeslam
