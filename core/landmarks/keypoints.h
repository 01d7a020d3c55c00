// SPDX-License-Identifier: Apache-2.0
// SIFT keypoints (docs/method.md, section 5.2) of the texture, each with the measured 3D point, and of the depth
// image; brute-force descriptor matching, the reference for faster searches (section 5.4).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <opencv2/core.hpp>
#include <tuple>
#include <vector>

#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct KeypointOptions {
  int max_keypoints = 2500;
  double contrast_threshold = 0.003;  // of SIFT's differences of Gaussians, image scaled to [0, 1]
  double edge_threshold = 10;
  double pixel_sigma = 0.1;  // localisation sigma of a keypoint of SIFT scale 1.6, px; grows with the scale
  int max_depth_keypoints = 600;
  double depth_contrast_threshold = 0.001;
  double depth_edge_threshold = 100;
  bool texture_halved = false;
  bool depth_halved = true;
  bool root_sift = true;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_keypoints", max_keypoints, {10, 100000}, "number of strongest texture keypoints kept");
    v.field("max_depth_keypoints", max_depth_keypoints, {10, 100000}, "number of strongest depth-image keypoints kept");
    v.field("contrast_threshold", contrast_threshold, {1e-5, 1}, "SIFT contrast threshold of texture keypoints");
    v.field("depth_contrast_threshold", depth_contrast_threshold, {1e-5, 1},
            "SIFT contrast threshold of the depth image after stretching its range to full scale");
    v.field("depth_edge_threshold", depth_edge_threshold, {1, 1000},
            "SIFT edge threshold of the depth image, whose corners lie on edges");
    v.field("texture_halved", texture_halved,
            "detect texture keypoints at half resolution: half the time, but fewer, less accurate keypoints");
    v.field("depth_halved", depth_halved, "detect depth-image keypoints at half resolution, in a quarter of the time");
    v.field("root_sift", root_sift, "compare descriptors by histogram overlap (RootSIFT), not by Euclidean distance");
    v.field("edge_threshold", edge_threshold, {1, 1000}, "SIFT edge threshold of texture keypoints");
    v.field("pixel_sigma", pixel_sigma, {0.01, 10}, "localisation sigma of the finest keypoints, px");
  }
};

struct MatchOptions {
  double max_ratio = 0.8;  // Lowe's ratio of the nearest to the second-nearest distance

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_ratio", max_ratio, {0.1, 1}, "largest ratio of nearest to second-nearest descriptor distance");
  }
};

// Detects SIFT keypoints of the texture and keeps those where the 3D point can be interpolated from the four pixels
// around. Throws Error for options out of range.
Keypoints detect_keypoints(const Frame& frame, const RigModel& rig, const PixelRays& rays,
                           const KeypointOptions& options);

// Detects SIFT keypoints of a depth image with levels 0 to 255, near being bright: the rows of matrix A (thesis Table
// 1). The 1st to 99th percentiles of the levels are stretched to the full range, so that shallow scenes have keypoints
// too. Throws Error for options out of range.
std::vector<DepthKeypoint> detect_depth_keypoints(const cv::Mat1f& levels, const KeypointOptions& options);

// Returns each keypoint's position index: the lowest index of the keypoints at its position, which differ in orientation.
std::vector<int> places_of(const std::vector<Keypoint>& keypoints);

// Sorts matches by their distances and keeps each position of both views at most once. `earlier_place` and `current_place`
// return the position index of a keypoint, less than the view's count.
template <class EarlierPlace, class CurrentPlace>
void keep_one_to_one(std::vector<KeypointMatch>& matches, size_t earlier_count, const EarlierPlace& earlier_place,
                     size_t current_count, const CurrentPlace& current_place) {
  std::sort(matches.begin(), matches.end(), [](const KeypointMatch& a, const KeypointMatch& b) {
    return std::tie(a.distance, a.current, a.earlier) < std::tie(b.distance, b.current, b.earlier);
  });
  std::vector<char> earlier_taken(earlier_count), current_taken(current_count);
  std::erase_if(matches, [&](const KeypointMatch& match) {
    char& e = earlier_taken[static_cast<size_t>(earlier_place(match.earlier))];
    char& c = current_taken[static_cast<size_t>(current_place(match.current))];
    const bool taken = e || c;
    if (!taken) e = c = 1;
    return taken;
  });
}

// Returns the pairs that are mutual nearest neighbours and pass the ratio test, in the order of `current`. If pairs
// share a position in either view, only the nearest of them counts: further orientations are no further evidence of a motion.
std::vector<KeypointMatch> match_keypoints(const Keypoints& earlier, const Keypoints& current,
                                           const MatchOptions& options);

}  // namespace fringeslam
