// SPDX-License-Identifier: Apache-2.0
// Draws 3D lines over a rendered overview; occluded parts are drawn fainter.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "sim/preview/overview.h"

namespace fringeslam::sim {

struct Pen {
  cv::Scalar colour;  // BGR
  double width_px = 1;
  double strength = 1;  // opacity of unoccluded parts, 0 to 1
};

class LineDrawing {
 public:
  LineDrawing(const Viewpoint& viewpoint, const cv::Mat1f& distance_m)
      : viewpoint_(viewpoint), distance_m_(distance_m) {}

  // Add primitives in world coordinates, m.
  void line(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Pen& pen);
  void polygon(const std::vector<Eigen::Vector3d>& corners, const Pen& pen);
  void dot(const Eigen::Vector3d& at, double radius_px, const Pen& pen);

  // Draws all primitives onto the picture in order of increasing opacity, so that occluded parts come first.
  void paint(cv::Mat3b& picture) const;

 private:
  struct Stroke {
    Pen pen;
    bool hidden = false;
    double radius_px = 0;  // radius of a dot; 0: line segment
    std::vector<cv::Point2d> points;
  };
  bool hides(const Eigen::Vector3d& in_view) const;
  cv::Point2d pixel(const Eigen::Vector3d& in_view) const;

  const Viewpoint& viewpoint_;
  const cv::Mat1f& distance_m_;
  std::vector<Stroke> strokes_;
};

}  // namespace fringeslam::sim
