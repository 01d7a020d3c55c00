// SPDX-License-Identifier: Apache-2.0
// Extraction of the edges of foreground objects from a depth image (docs/method.md, sections 4.2 and 5.1; thesis 3.1).
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "core/landmarks/bit_image.h"
#include "core/landmarks/edges.h"
#include "core/types/frame.h"
#include "core/types/options.h"

namespace fringeslam {

// Background: a plane with nothing behind it, all points beyond background_m, or none.
enum class Background { plane, depth, none };

constexpr auto choices(Background) {
  using enum Background;
  return std::to_array<Choice<Background>>({{plane, "plane"}, {depth, "depth"}, {none, "none"}});
}

struct ConditioningOptions {
  Background background = Background::plane;
  double background_m = 1.4;
  double plane_clearance_m = 0.008;
  EdgeDetector edges = EdgeDetector::canny_deriche;
  double deriche_alpha = 1;
  double low_step_m = 0.006, high_step_m = 0.012;
  int max_dilations = 3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("background", background,
            "background: a plane with nothing behind it, all points beyond background_m, or none");
    v.field("background_m", background_m, {0.01, 100}, "depth beyond which pixels are background");
    v.field("plane_clearance_m", plane_clearance_m, {1e-4, 1},
            "points within this distance in front of the plane belong to it, m");
    v.field("edges", edges, "edge detector");
    v.field("deriche_alpha", deriche_alpha, {0.1, 5}, "width of the Deriche filter is 1/alpha px");
    v.field("low_step_m", low_step_m, {1e-5, 10}, "least step of an edge connected to a strong edge (hysteresis), m");
    v.field("high_step_m", high_step_m, {1e-5, 10}, "least step of a strong edge, m");
    v.field("max_dilations", max_dilations, {0, 20}, "largest number of 3x3 dilations to close gaps in edges");
  }
};

// Results of the stages as in the thesis, each H x W; masks are 255 or 0.
struct Conditioned {
  cv::Mat1b foreground;       // has a depth and is not background
  BitImage edges = {0, 0};    // of the depth image, within one pixel of the foreground
  BitImage dilated = {0, 0};  // until gaps are closed
  BitImage thinned = {0, 0};  // to one pixel width
  cv::Mat1b cleaned;          // without open lines
  int dilations = 0;
};

// Runs all stages. Throws Error for options out of range. A frame without depth has neither foreground nor
// edges.
Conditioned condition(const Frame& frame, const ConditioningOptions& options);

// Converts depth to levels as in docs/method.md, section 4.2, but not rounded, so that slanted surfaces have no steps:
// 255 at near_m, 0 at far_m. Pixels without depth take the farther of the nearest valid neighbours to the left and
// right, since a projector shadow belongs to the surface behind.
cv::Mat1f depth_levels(const Frame& frame, double near_m, double far_m);

}  // namespace fringeslam
