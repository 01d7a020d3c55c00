// SPDX-License-Identifier: Apache-2.0
// Keypoints and the landmarks that they make up (METHOD S11-S18): plain values that the stages, the score and the
// files share. Positions are px with pixel centres at integers; points are m in the camera's frame.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

// A keypoint of the texture where a depth was measured.
struct Keypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double scale = 0;  // SIFT's sigma, px
  double angle_rad = 0;
  double strength = 0;  // SIFT's response
  Eigen::Vector3d point_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();
};

struct Keypoints {
  std::vector<Keypoint> keypoints;  // only those where a depth was measured
  cv::Mat1f descriptors;            // N x 128, unit length
  int detected = 0;                 // with and without depth
};

// A keypoint of the depth image: a row of matrix A (thesis Table 1) and, once it is clustered, the columns that
// clustering adds (S14).
struct DepthKeypoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  int level = 0;  // of the depth image, 255 near; the nearest of the 3x3 pixels around
  double scale = 0, angle_rad = 0;
  double strength = 0;         // SIFT's response
  int cluster = -1;            // -1: of none
  int order = -1;              // in which it came to the cluster
  int connections = 0;         // to others of the cluster
  std::vector<uchar> samples;  // levels along the line by which it came
};

// Of a landmark's pixels whose temperature is known, in degrees C.
struct LandmarkTemperature {
  int pixels = 0;                                         // 0: none is, and the rest says nothing
  double mean_c = 0, max_c = 0, p95_c = 0, spread_c = 0;  // spread: standard deviation
  double warm_share = 0;                                  // of the pixels that stand out from the surroundings
  std::vector<int> regions;                               // of the view's warm regions that lie on it
};

struct Landmark {
  std::vector<int> depth_keypoints;  // of its cluster, in their order
  std::vector<cv::Point> outline;    // polygon in the image; the texture's keypoints in it are the landmark's
  std::vector<int> keypoints;        // of the texture
  LandmarkTemperature temperature = {};
};

struct Landmarks {
  Keypoints keypoints;
  std::vector<DepthKeypoint> depth_keypoints;  // in the foreground
  int background_keypoints = 0;                // of the depth image, discarded (S12)
  std::vector<cv::Vec2i> connections;          // of depth keypoints, within clusters
  std::vector<Landmark> landmarks;
  int without_hull = 0;  // clusters of one or two corners, which bound nothing
  int indistinct = 0;    // hulls with too few keypoints of the texture to be recognised
};

// A keypoint of the current view and one of an earlier view that are taken for the same.
struct KeypointMatch {
  int earlier = 0, current = 0;  // indices of the views' texture keypoints
  double distance = 0, ratio = 0;
};

// A landmark of the current view that was seen before.
struct Recognition {
  int landmark = 0;                             // of the current view
  int earlier_frame = 0, earlier_landmark = 0;  // where it was seen
  std::vector<KeypointMatch> matches;           // verified: consistent with one rigid motion
  Pose earlier_from_current;                    // of the camera, by these matches alone
};

}  // namespace fringeslam
