// SPDX-License-Identifier: Apache-2.0
// From a depth image to the edges of what stands in the foreground (METHOD S5-S10; thesis 3.1).
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "core/landmarks/bit_image.h"
#include "core/landmarks/edges.h"
#include "core/types/frame.h"
#include "core/types/options.h"

namespace fringeslam {

struct ConditioningOptions {
  std::string background = "plane";
  double background_m = 1.4;
  double plane_clearance_m = 0.008;
  std::string edges = "canny_deriche";
  double deriche_alpha = 1;
  double low_step_m = 0.006, high_step_m = 0.012;
  int max_dilations = 3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("background", background, {"plane", "depth", "none"},
            "what counts as background: a plane with nothing behind it, what is beyond background_m, or nothing");
    v.field("background_m", background_m, {0.01, 100}, "depth from which on pixels are background");
    v.field("plane_clearance_m", plane_clearance_m, {1e-4, 1}, "what stands out less from the plane belongs to it");
    v.field("edges", edges, edge_detectors(), "edge detector");
    v.field("deriche_alpha", deriche_alpha, {0.1, 5}, "width of the Deriche filter is 1/alpha px");
    v.field("low_step_m", low_step_m, {1e-5, 10}, "least step of an edge that is linked with a strong one");
    v.field("high_step_m", high_step_m, {1e-5, 10}, "least step of a strong edge");
    v.field("max_dilations", max_dilations, {0, 20}, "most dilations by 3x3 that close gaps in edges");
  }
};

// The stages as the thesis shows them, each H x W; masks are 255 or 0.
struct Conditioned {
  cv::Mat1b foreground;       // has a depth and is no background (S6)
  BitImage edges = {0, 0};    // of the depth image (S7), where the foreground is or touches
  BitImage dilated = {0, 0};  // until gaps are closed (S8)
  BitImage thinned = {0, 0};  // back to one pixel (S9)
  cv::Mat1b cleaned;          // without what does not connect (S10)
  int dilations = 0;
};

// Throws Error for options out of range. A frame without any depth has neither foreground nor edges.
Conditioned condition(const Frame& frame, const ConditioningOptions& options);

// Depth in levels as METHOD S5 has them but not rounded, so that slanted surfaces have no steps: 255 at near_m, 0 at
// far_m. What has no depth gets the farther one of its two neighbours in the row that have: a shadow of the projector
// belongs to what lies behind.
cv::Mat1f depth_levels(const Frame& frame, double near_m, double far_m);

}  // namespace fringeslam
