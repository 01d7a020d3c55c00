// SPDX-License-Identifier: Apache-2.0
// Lines in space over a picture of the world, fainter where the world hides them.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "sim/preview/overview.h"

namespace fringeslam::sim {

struct Pen {
  cv::Scalar colour;  // BGR
  double width_px = 1;
  double strength = 1;  // of the colour over the picture, where nothing hides the line
};

class LineDrawing {
 public:
  LineDrawing(const Viewpoint& viewpoint, const cv::Mat1f& distance_m)
      : viewpoint_(viewpoint), distance_m_(distance_m) {}

  // World, m.
  void line(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Pen& pen);
  void polygon(const std::vector<Eigen::Vector3d>& corners, const Pen& pen);
  void dot(const Eigen::Vector3d& at, double radius_px, const Pen& pen);

  // Everything onto the picture: what is hidden first, and the strongest last.
  void paint(cv::Mat3b& picture) const;

 private:
  struct Stroke {
    Pen pen;
    bool hidden = false;
    double radius_px = 0;  // of a dot; 0: a line
    std::vector<cv::Point2d> points;
  };
  bool hides(const Eigen::Vector3d& in_view) const;
  cv::Point2d pixel(const Eigen::Vector3d& in_view) const;

  const Viewpoint& viewpoint_;
  const cv::Mat1f& distance_m_;
  std::vector<Stroke> strokes_;
};

}  // namespace fringeslam::sim
