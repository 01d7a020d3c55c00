// SPDX-License-Identifier: Apache-2.0
// Keypoints and landmarks (docs/method.md, sections 5.2 to 5.4): value types shared by the stages, scoring and file
// I/O. Image positions are in px with pixel centres at integers; points are in m in the camera frame.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

// Texture keypoint with a measured depth.
struct Keypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double scale = 0;  // SIFT's sigma, px
  double angle_rad = 0;
  double strength = 0;  // SIFT's response
  Eigen::Vector3d point_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();
};

struct Keypoints {
  std::vector<Keypoint> keypoints;  // only those with a measured depth
  cv::Mat1f descriptors;            // N x 128, unit length
  int detected = 0;                 // with or without depth
};

// Keypoint of the depth image: one row of matrix A (thesis Table 1) and, after clustering, the columns that clustering
// adds (docs/method.md, section 5.3).
struct DepthKeypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  int level = 0;  // depth-image grey level, 255 = near; maximum over the 3x3 neighbourhood
  double scale = 0, angle_rad = 0;
  double strength = 0;         // SIFT's response
  int cluster = -1;            // -1: not clustered
  int order = -1;              // order in which it joined the cluster
  int connections = 0;         // number of connections to others of the cluster
  std::vector<uchar> samples;  // grey levels along the line that connected it
};

// Temperature statistics of a landmark's pixels, degrees C.
struct LandmarkTemperature {
  int pixels = 0;                                         // with known temperature; 0: other values undefined
  double mean_c = 0, max_c = 0, p95_c = 0, spread_c = 0;  // spread: standard deviation
  double warm_share = 0;                                  // fraction of pixels warmer than the surroundings
  std::vector<int> regions;                               // indices of the view's warm regions on the landmark
};

struct Landmark {
  std::vector<int> depth_keypoints;  // of its cluster, in cluster order
  std::vector<cv::Point> outline;    // polygon in the image; texture keypoints inside belong to the landmark
  std::vector<int> keypoints;        // indices of texture keypoints
};

struct Landmarks {
  Keypoints keypoints;
  std::vector<DepthKeypoint> depth_keypoints;  // in the foreground
  int background_keypoints = 0;                // of the depth image; discarded
  std::vector<cv::Vec2i> connections;          // pairs of depth keypoints within clusters
  std::vector<Landmark> landmarks;
  int dilations = 0;     // until the holes in the edges were closed
  int without_hull = 0;  // clusters with fewer than three corners, which enclose no area
  int indistinct = 0;    // hulls with too few texture keypoints for re-identification
};

// Match between texture keypoints of an earlier view and the current view.
struct KeypointMatch {
  int earlier = 0, current = 0;  // indices of the views' texture keypoints
  double distance = 0, ratio = 0;
};

// Re-identification of a landmark of the current view in an earlier view.
struct Recognition {
  int landmark = 0;                             // in the current view
  int earlier_frame = 0, earlier_landmark = 0;  // earlier view and the landmark's index in it
  std::vector<KeypointMatch> matches;           // verified: consistent with one rigid transform
  Pose earlier_from_current;                    // camera motion estimated from these matches only
};

}  // namespace fringeslam
