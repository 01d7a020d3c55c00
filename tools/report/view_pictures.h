// SPDX-License-Identifier: Apache-2.0
// Pictures of a run's views for a page of limited size: textures as JPEG; depth and depth error as grey-level PNG that
// the page colours, so that it can show values and no precision is lost to a palette.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam::tools {

struct ViewImages {
  int index = 0;
  cv::Mat1b texture;
  cv::Mat1f depth_m;
  cv::Mat1f error_m;             // estimate minus ground truth; empty if unknown
  cv::Mat1f temperature_c = {};  // empty without a thermal camera
};

// Scales down to at most `max_width`; depth uses the nearest pixel, since a mean across an edge lies on no surface.
ViewImages shrunk(const ViewImages& view, int max_width);

// Values at the ends of the pictures' scales.
struct PictureScales {
  double white = 255;  // grey value
  double near_m = 0, far_m = 1;
  double error_limit_m = 1e-3;  // symmetric
  double cold_c = 0, warm_c = 40;
};

// Derives the scales from the views: the 99.5 % quantile of grey, the 0.5 and 99.5 % quantiles of depth,
// error_limit_m() of the errors, and the 1 % quantile of temperature plus a span that separates skin from hot objects.
PictureScales picture_scales(const std::vector<ViewImages>& views);

// Returns four times the median magnitude, rounded up to 1, 2 or 5 of a decade, so that typical errors get most of the
// colours. `errors` may contain NaN; 0 if there is nothing else.
double error_limit_m(const std::vector<float>& errors);

// Maps [low, high] to levels 1 to 255, clamped; NaN to 0.
cv::Mat1b levels(const cv::Mat1f& values, double low, double high);

// Returns for each view {width, height, texture, depth, error, temperature} with data URLs, together about `max_bytes`
// or less: all pictures are scaled down by the same factor.
std::vector<nlohmann::ordered_json> encoded(const std::vector<ViewImages>& views, const PictureScales& scales,
                                            size_t max_bytes);

}  // namespace fringeslam::tools
