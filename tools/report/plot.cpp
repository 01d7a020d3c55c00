// SPDX-License-Identifier: Apache-2.0
#include "tools/report/plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace fringeslam::tools {

namespace {

constexpr int kSize = 640, kLeft = 70, kTop = 40, kRight = 30, kBottom = 60, kShift = 4;

// Distance of grid lines: 1, 2 or 5 times a power of ten, 5 to 10 lines over the axis.
double grid_step(const PlotAxis& axis) {
  const double rough = (axis.high - axis.low) / 10, power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough * (1 - 1e-9)) return factor * power;
  }
  return 10 * power;
}

void write(cv::Mat3b& picture, const std::string& text, const cv::Point& center, double scale) {
  const cv::Size size = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, 1, nullptr);
  cv::putText(picture, text, {center.x - size.width / 2, center.y + size.height / 2}, cv::FONT_HERSHEY_SIMPLEX, scale,
              cv::Scalar::all(200), 1, cv::LINE_AA);
}

}  // namespace

cv::Mat3b draw(const Plot& plot) {
  cv::Mat3b picture(kTop + kSize + kBottom, kLeft + kSize + kRight, cv::Vec3b(30, 30, 30));
  const auto place = [&](const cv::Point2d& at) {
    const double x = (at.x - plot.x.low) / (plot.x.high - plot.x.low);
    const double y = std::clamp((at.y - plot.y.low) / (plot.y.high - plot.y.low), -1.0, 2.0);
    return cv::Point(static_cast<int>(std::lround((kLeft + kSize * x) * (1 << kShift))),
                     static_cast<int>(std::lround((kTop + kSize * (1 - y)) * (1 << kShift))));
  };
  const auto pixel = [&](const cv::Point2d& at) {
    const cv::Point p = place(at);
    return cv::Point(p.x >> kShift, p.y >> kShift);
  };
  const auto line = [&](const cv::Point2d& from, const cv::Point2d& to, const cv::Scalar& color, int width) {
    cv::line(picture, place(from), place(to), color, width, cv::LINE_AA, kShift);
  };
  char text[32];
  const auto grid = [&](const PlotAxis& axis, auto&& draw_at) {
    const double step = grid_step(axis);
    const auto first = static_cast<long>(std::ceil(axis.low / step - 1e-9));
    const auto last = static_cast<long>(std::floor(axis.high / step + 1e-9));
    for (long i = first; i <= last; ++i) {
      std::snprintf(text, sizeof text, "%g", static_cast<double>(i) * step);
      draw_at(static_cast<double>(i) * step);
    }
  };
  grid(plot.x, [&](double x) {
    line({x, plot.y.low}, {x, plot.y.high}, cv::Scalar::all(55), 1);
    write(picture, text, pixel({x, plot.y.low}) + cv::Point(0, 16), 0.45);
  });
  grid(plot.y, [&](double y) {
    line({plot.x.low, y}, {plot.x.high, y}, cv::Scalar::all(55), 1);
    write(picture, text, pixel({plot.x.low, y}) - cv::Point(32, 0), 0.45);
  });
  write(picture, plot.x.label, {kLeft + kSize / 2, kTop + kSize + 42}, 0.6);
  const cv::Size label = cv::getTextSize(plot.y.label, cv::FONT_HERSHEY_SIMPLEX, 0.6, 1, nullptr);
  write(picture, plot.y.label, {kLeft + label.width / 2, kTop / 2}, 0.6);

  cv::Mat3b clipped = picture.clone();
  for (const PlotLine& l : plot.lines) {
    for (size_t i = 1; i < l.points.size(); ++i) line(l.points[i - 1], l.points[i], cv::Scalar(l.color), l.width);
  }
  for (const PlotMarks& m : plot.marks) {
    for (size_t i = 0; i < m.points.size(); ++i) {
      const cv::Point2d& at = m.points[i];
      if (!m.sigma.empty()) line({at.x, at.y - m.sigma[i]}, {at.x, at.y + m.sigma[i]}, cv::Scalar(m.color), 1);
      cv::circle(picture, place(at), 4 << kShift, cv::Scalar(m.color), cv::FILLED, cv::LINE_AA, kShift);
    }
  }
  const cv::Rect frame(kLeft - 5, kTop - 5, kSize + 10, kSize + 10);
  picture(frame).copyTo(clipped(frame));
  return clipped;
}

}  // namespace fringeslam::tools
