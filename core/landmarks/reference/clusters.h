// SPDX-License-Identifier: Apache-2.0
// Clusters of depth keypoints (METHOD S13, S14; thesis 3.2.2, conference paper III.B eq. 4-6).
//
// Region search: from a start, a square grows until it holds keypoints; one joins where the straight line to it
// crosses no edge. Depth sampling: of those in the square the nearest neighbour is the one of least depth change whose
// line's samples stay within the two depths, by a threshold, and whose line crosses no earlier one; a member needs two
// connections.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/types/landmark.h"
#include "core/types/options.h"

namespace fringeslam {

struct ClusterOptions {
  std::string method = "both";
  std::string starts = "both";
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
    v.field("method", method, {"depth_sampling", "convex_hull", "both"},
            "depth sampling and the area its lines enclose, region search and its convex hull, or the convex hull of "
            "depth sampling");
    v.field("starts", starts, {"random", "corners", "both"}, "where searches start: anywhere, or the image's corners");
    v.field("random_starts", random_starts, {0, 100000}, "number of random starts");
    v.field("seed", seed, {0, 2147483647}, "seed of the random starts");
    v.field("samples", samples, {1, 1000}, "depth samples on a line");
    v.field("max_depth_change", max_depth_change, {0, 255}, "largest difference of levels within a cluster");
    v.field("sample_threshold", sample_threshold, {0, 255}, "how far samples may lie outside the two depths, levels");
    v.field("line_end_px", line_end_px, {0, 100},
            "edges this near to a line's end, where its keypoint is, do not count");
    v.field("max_radius_px", max_radius_px, {1, 10000}, "half the side of the largest square");
    v.field("max_keypoints", max_keypoints, {1, 100000}, "strongest depth keypoints that are clustered");
  }
};

struct Clusters {
  std::vector<std::vector<int>> members;  // of each cluster, in the order in which they came
  std::vector<cv::Vec2i> connections;     // of keypoints
};

// `levels`: the depth image, 255 near; `edges`: 255 on edges; of one size. Fills the keypoints' columns cluster, order,
// connections and samples. Keypoints outside the image or without finite coordinates stay without a cluster. The same
// input and seed give the same clusters.
Clusters find_clusters(std::vector<DepthKeypoint>& keypoints, const cv::Mat1b& levels, const cv::Mat1b& edges,
                       const ClusterOptions& options);

}  // namespace fringeslam
