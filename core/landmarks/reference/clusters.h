// SPDX-License-Identifier: Apache-2.0
// Clusters of depth keypoints (docs/method.md, section 5.3; thesis 3.2.2; conference paper III.B, eq. 4-6).
//
// Region search: a square grows around each member until it contains free keypoints; one joins if the straight line to
// it crosses no edge. Depth sampling: among the keypoints in the square, the one with the smallest depth change joins,
// provided that the samples along the line stay within the two depths up to a threshold and that the line crosses no
// earlier line; every member needs two connections.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/landmark.h"
#include "core/types/options.h"

namespace fringeslam {

// Depth sampling with the area enclosed by its lines, region search with its convex hull, or depth sampling with its
// convex hull.
enum class ClusterMethod { depth_sampling, convex_hull, both };

constexpr auto choices(ClusterMethod) {
  using enum ClusterMethod;
  return std::to_array<Choice<ClusterMethod>>(
      {{depth_sampling, "depth_sampling"}, {convex_hull, "convex_hull"}, {both, "both"}});
}

// Start points of the search: random positions, the image's corners, or both.
enum class ClusterStarts { random, corners, both };

constexpr auto choices(ClusterStarts) {
  using enum ClusterStarts;
  return std::to_array<Choice<ClusterStarts>>({{random, "random"}, {corners, "corners"}, {both, "both"}});
}

struct ClusterOptions {
  ClusterMethod method = ClusterMethod::both;
  ClusterStarts starts = ClusterStarts::both;
  int random_starts = 40;
  int seed = 1;
  int samples = 16;
  int max_depth_change = 80;
  int sample_threshold = 20;
  int line_end_px = 3;
  int max_radius_px = 120;
  int max_keypoints = 2000;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("method", method,
            "depth sampling with the area enclosed by its lines, region search with its convex hull, or depth sampling "
            "with its convex hull");
    v.field("starts", starts, "start points of the search: random positions, the image's corners, or both");
    v.field("random_starts", random_starts, {0, 100000}, "number of random starts");
    v.field("seed", seed, {0, 2147483647}, "seed of the random starts");
    v.field("samples", samples, {1, 1000}, "depth samples per line");
    v.field("max_depth_change", max_depth_change, {0, 255}, "largest level difference within a cluster");
    v.field("sample_threshold", sample_threshold, {0, 255},
            "tolerance of samples outside the range of the two depths, levels");
    v.field("line_end_px", line_end_px, {0, 100},
            "edges within this distance of a line's ends, where its keypoints are, are ignored, pixels");
    v.field("max_radius_px", max_radius_px, {1, 10000}, "half the side of the largest square, pixels");
    v.field("max_keypoints", max_keypoints, {1, 100000}, "number of strongest depth keypoints that are clustered");
  }
};

struct Clusters {
  std::vector<std::vector<int>> members;  // keypoints of each cluster, in the order in which they joined
  std::vector<cv::Vec2i> connections;     // pairs of connected keypoints
};

// Clusters the keypoints and fills their columns cluster, order, connections and samples. `levels` is the depth image
// (255 near), `edges` is 255 on edges; both have the same size. Keypoints outside the image or without finite
// coordinates belong to no cluster. The result is deterministic for a given input and seed. Throws Error if the sizes
// differ or options are out of range.
Clusters find_clusters(std::vector<DepthKeypoint>& keypoints, const cv::Mat1b& levels, const cv::Mat1b& edges,
                       const ClusterOptions& options);

}  // namespace fringeslam
