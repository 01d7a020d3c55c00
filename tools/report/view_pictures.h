// SPDX-License-Identifier: Apache-2.0
// The pictures of a run's views for a page of limited size: textures as JPEG; depth and depth error as grey PNG whose
// levels the page colours, so that it can tell values and nothing is lost to a palette.
#pragma once

#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam::tools {

struct ViewImages {
  int index = 0;
  cv::Mat1b texture;
  cv::Mat1f depth_m;
  cv::Mat1f error_m;             // estimate minus truth; empty where there is none
  cv::Mat1f temperature_c = {};  // empty without a thermal camera
};

// The same, no wider than `max_width`: depth of the nearest pixel, since a mean over an edge is nowhere.
ViewImages shrunk(const ViewImages& view, int max_width);

// What the ends of the pictures' scales stand for.
struct PictureScales {
  double white = 255;  // grey value
  double near_m = 0, far_m = 1;
  double error_limit_m = 1e-3;  // both ways
  double cold_c = 0, warm_c = 40;
};

// From the views' 99.5 % brightest grey value, their depths but 0.5 % to both sides, error_limit_m() of their errors,
// and their 1 % coldest temperature with as much above it as tells skin from what is hot.
PictureScales picture_scales(const std::vector<ViewImages>& views);

// Four times the median size, rounded up to 1, 2 or 5 of a decade: what is usual gets most of the colours. `errors` may
// hold NaN; 0 when they hold nothing else.
double error_limit_m(const std::vector<float>& errors);

// Levels 1 to 255 from `low` to `high`, beyond which they stay; 0 is NaN.
cv::Mat1b levels(const cv::Mat1f& values, double low, double high);

// An object for each view, {width, height, texture, depth, error, temperature} with data URLs, all together about
// `max_bytes` or less: pictures are scaled down by one factor.
std::vector<nlohmann::ordered_json> encoded(const std::vector<ViewImages>& views, const PictureScales& scales,
                                            size_t max_bytes);

}  // namespace fringeslam::tools
