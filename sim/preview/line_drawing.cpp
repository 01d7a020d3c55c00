// SPDX-License-Identifier: Apache-2.0
#include "sim/preview/line_drawing.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace fringeslam::sim {

namespace {

constexpr double kHiddenStrength = 0.28;
constexpr int kShift = 4;  // fractional bits of OpenCV's fixed-point coordinates

cv::Point fixed_point(const cv::Point2d& p) {
  const double scale = 1 << kShift;
  return {static_cast<int>(std::lround(p.x * scale)), static_cast<int>(std::lround(p.y * scale))};
}

}  // namespace

cv::Point2d LineDrawing::pixel(const Eigen::Vector3d& in_view) const {
  const Eigen::Vector2d p = viewpoint_.camera.project(in_view);
  return {p.x(), p.y()};
}

// True if the overview's surface occludes the point; a tolerance keeps points on the surface visible.
bool LineDrawing::hides(const Eigen::Vector3d& in_view) const {
  constexpr double kTolerance = 0.004;
  const cv::Point2d at = pixel(in_view);
  const int col = static_cast<int>(std::lround(at.x)), row = static_cast<int>(std::lround(at.y));
  if (row < 0 || col < 0 || row >= distance_m_.rows || col >= distance_m_.cols) return false;
  return in_view.norm() > static_cast<double>(distance_m_(row, col)) * (1 + kTolerance);
}

void LineDrawing::line(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Pen& pen) {
  const Pose view_from_world = viewpoint_.world_from_camera.inverse();
  Eigen::Vector3d a = view_from_world * from, b = view_from_world * to;
  // Clip the part behind the viewer.
  const double nearest = 1e-3 * std::max(a.norm(), b.norm());
  if (a.z() < nearest && b.z() < nearest) return;
  if (a.z() < nearest) a += (b - a) * ((nearest - a.z()) / (b.z() - a.z()));
  if (b.z() < nearest) b += (a - b) * ((nearest - b.z()) / (a.z() - b.z()));
  const double length_px = std::min(cv::norm(pixel(b) - pixel(a)), 20000.0);
  const int steps = std::max(1, static_cast<int>(length_px / 1.5));
  for (int i = 0; i < steps; ++i) {
    // Equal steps in the image: 1 / z is linear along the projected line.
    const auto at = [&](double share) {
      const double t = share * a.z() / (b.z() + share * (a.z() - b.z()));
      return Eigen::Vector3d(a + t * (b - a));
    };
    const bool hidden = hides(at((i + 0.5) / steps));
    const bool goes_on = i > 0 && strokes_.back().hidden == hidden;
    if (!goes_on) strokes_.push_back({pen, hidden, 0, {pixel(at(static_cast<double>(i) / steps)), {}}});
    strokes_.back().points[1] = pixel(at((i + 1.0) / steps));
  }
}

void LineDrawing::polygon(const std::vector<Eigen::Vector3d>& corners, const Pen& pen) {
  for (size_t i = 0; i < corners.size(); ++i) line(corners[i], corners[(i + 1) % corners.size()], pen);
}

void LineDrawing::dot(const Eigen::Vector3d& at, double radius_px, const Pen& pen) {
  const Eigen::Vector3d in_view = viewpoint_.world_from_camera.inverse() * at;
  if (in_view.z() > 0) strokes_.push_back({pen, hides(in_view), radius_px, {pixel(in_view)}});
}

void LineDrawing::paint(cv::Mat3b& picture) const {
  const auto strength_of = [](const Stroke& stroke) {
    return stroke.pen.strength * (stroke.hidden ? kHiddenStrength : 1);
  };
  std::vector<const Stroke*> order;
  for (const Stroke& stroke : strokes_) order.push_back(&stroke);
  std::stable_sort(order.begin(), order.end(),
                   [&](const Stroke* a, const Stroke* b) { return strength_of(*a) < strength_of(*b); });
  for (size_t first = 0; first < order.size();) {
    const double strength = strength_of(*order[first]);
    cv::Mat3b drawn = picture.clone();
    for (; first < order.size() && strength_of(*order[first]) == strength; ++first) {
      const Stroke& stroke = *order[first];
      const int width = std::max(1, static_cast<int>(std::lround(stroke.pen.width_px)));
      if (stroke.radius_px > 0) {
        cv::circle(drawn, fixed_point(stroke.points[0]), static_cast<int>(stroke.radius_px * (1 << kShift)),
                   stroke.pen.colour, cv::FILLED, cv::LINE_AA, kShift);
      } else {
        cv::line(drawn, fixed_point(stroke.points[0]), fixed_point(stroke.points[1]), stroke.pen.colour, width,
                 cv::LINE_AA, kShift);
      }
    }
    cv::addWeighted(drawn, strength, picture, 1 - strength, 0, picture);
  }
}

}  // namespace fringeslam::sim
