// SPDX-License-Identifier: Apache-2.0
// Connected foreground regions. They replace clusters of depth keypoints where those are too few to bound an object: a
// flat face has depth keypoints only at its corners, yet it is a good landmark.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

struct Region {
  int area_px = 0;
  std::vector<cv::Point> outline;  // outer boundary, a polygon of pixels
};

struct Regions {
  cv::Mat1i labels;  // H x W: region number from 1; 0 for none
  std::vector<Region> regions;
};

// Splits `area` into regions, separating parts that are joined by bridges at most 2 * bridge_px pixels wide: the area
// is eroded by bridge_px pixels, its 4-connected components are labelled, and the labels grow back over the eroded
// border. Regions whose eroded area is below min_area_px / 2 are dropped. Regions are numbered in row-major order.
Regions find_regions(const cv::Mat1b& area, int bridge_px, int min_area_px);

// Grows labels into unlabelled pixels of `area` by one pixel along rows and columns per round; where two labels meet,
// the one that arrived first stays.
void grow_labels(cv::Mat1i& labels, const cv::Mat1b& area, int rounds);

}  // namespace fringeslam
