// SPDX-License-Identifier: Apache-2.0
// Connected pieces of the foreground: what clusters of depth keypoints stand for where they are too few to bound it. A
// flat face has none but at its corners, and is the better landmark for it.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct Region {
  int area_px = 0;
  std::vector<cv::Point> outline;  // the outer border, a polygon of pixels
};

struct Regions {
  cv::Mat1i labels;  // H x W: the region's number from 1, 0: of none
  std::vector<Region> regions;
};

// Pieces of `area` that touch by bridges of at most 2 * bridge_px pixels come apart: the area without its border of
// bridge_px pixels is labelled by connection (four neighbours), and the labels grow back over the border. Pieces of
// fewer than min_area_px pixels are none. Numbered in the order of rows and columns.
Regions find_regions(const cv::Mat1b& area, int bridge_px, int min_area_px);

// Labels spread over unlabelled pixels of `area`, by one pixel along rows and columns in each round; of two that meet
// the one that came first.
void grow_labels(cv::Mat1i& labels, const cv::Mat1b& area, int rounds);

}  // namespace fringeslam
