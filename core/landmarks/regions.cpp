// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/regions.h"

#include <opencv2/imgproc.hpp>

#include "core/landmarks/morphology.h"

namespace fringeslam {

namespace {

// Erodes the area by `border_px` pixels.
cv::Mat1b core_of(const cv::Mat1b& area, int border_px) {
  cv::Mat1b outside;
  cv::bitwise_not(area, outside);
  BitImage bits = BitImage::from(outside);
  for (int i = 0; i < border_px; ++i) bits = dilated(bits);
  cv::Mat1b core;
  cv::bitwise_not(bits.mask(), core);
  return core;
}

}  // namespace

void grow_labels(cv::Mat1i& labels, const cv::Mat1b& area, int rounds) {
  std::vector<cv::Point> front;
  for (int r = 0; r < labels.rows; ++r) {
    for (int c = 0; c < labels.cols; ++c) {
      if (labels(r, c)) front.emplace_back(c, r);
    }
  }
  for (int round = 0; round < rounds && !front.empty(); ++round) {
    std::vector<cv::Point> next;
    for (const cv::Point& p : front) {
      for (const cv::Point& step : {cv::Point(1, 0), cv::Point(-1, 0), cv::Point(0, 1), cv::Point(0, -1)}) {
        const cv::Point q = p + step;
        if (q.x < 0 || q.y < 0 || q.x >= labels.cols || q.y >= labels.rows || labels(q) || !area(q)) continue;
        labels(q) = labels(p);
        next.push_back(q);
      }
    }
    front = std::move(next);
  }
}

Regions find_regions(const cv::Mat1b& area, int bridge_px, int min_area_px) {
  Regions result;
  result.labels = cv::Mat1i(area.size(), 0);
  if (area.empty()) return result;
  cv::Mat labels, stats, centres;
  const int count = cv::connectedComponentsWithStats(core_of(area, bridge_px), labels, stats, centres, 4, CV_32S);
  std::vector<int> number(static_cast<size_t>(count), 0);
  for (int i = 1; i < count; ++i) {
    // A component of the eroded area; small ones are dropped.
    if (stats.at<int>(i, cv::CC_STAT_AREA) * 2 < min_area_px) continue;
    result.regions.push_back({});
    number[static_cast<size_t>(i)] = static_cast<int>(result.regions.size());
  }
  for (int r = 0; r < area.rows; ++r) {
    for (int c = 0; c < area.cols; ++c) result.labels(r, c) = number[static_cast<size_t>(labels.at<int>(r, c))];
  }
  grow_labels(result.labels, area, 2 * bridge_px + 1);
  for (size_t i = 0; i < result.regions.size(); ++i) {
    Region& region = result.regions[i];
    const cv::Mat1b mask(result.labels == static_cast<int>(i) + 1);
    region.area_px = cv::countNonZero(mask);
    std::vector<std::vector<cv::Point>> outlines;
    cv::findContours(mask, outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
    for (auto& outline : outlines) {
      if (outline.size() > region.outline.size()) region.outline = std::move(outline);
    }
  }
  return result;
}

}  // namespace fringeslam
