// SPDX-License-Identifier: Apache-2.0
#include "tools/report/pictures.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace fringeslam::tools {

namespace {

const cv::Scalar kPaper(24, 22, 20), kInk(225, 225, 225);
const cv::Scalar kGreen(90, 210, 90), kRed(70, 70, 235), kYellow(60, 210, 240);

void put_text(cv::Mat3b& image, const std::string& text, cv::Point at, double size) {
  cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, size, kInk, 1, cv::LINE_AA);
}

}  // namespace

cv::Mat3b false_colour(const cv::Mat1f& values, double low, double high) {
  cv::Mat1b scaled(values.size());
  cv::Mat1b missing(values.size());
  for (int row = 0; row < values.rows; ++row) {
    for (int col = 0; col < values.cols; ++col) {
      const double value = values(row, col);
      missing(row, col) = std::isnan(value) ? 255 : 0;
      const double grey = std::clamp(255 * (value - low) / (high - low), 0.0, 255.0);
      scaled(row, col) = std::isnan(value) ? uchar{0} : static_cast<uchar>(std::lround(grey));
    }
  }
  cv::Mat3b colours;
  cv::applyColorMap(scaled, colours, cv::COLORMAP_TURBO);
  colours.setTo(cv::Scalar::all(0), missing);
  return colours;
}

cv::Mat3b shaded_picture(const cv::Mat3f& normals) {
  cv::Mat3b picture(normals.size(), cv::Vec3b(0, 0, 0));
  // Normals face the camera, towards -z; y points down.
  const cv::Vec3f light = cv::normalize(cv::Vec3f(-0.5f, -0.7f, -1.0f));
  for (int row = 0; row < normals.rows; ++row) {
    for (int col = 0; col < normals.cols; ++col) {
      const cv::Vec3f& n = normals(row, col);
      if (n[2] != n[2]) continue;
      const auto grey = cv::saturate_cast<uchar>(30 + 225 * std::max(0.0f, n.dot(light)));
      picture(row, col) = cv::Vec3b(grey, grey, grey);
    }
  }
  return picture;
}

std::pair<double, double> content_limits(const cv::Mat1f& values) {
  std::vector<float> valid;
  for (const float value : values) {
    if (value == value) valid.push_back(value);
  }
  if (valid.size() < 2) return {0, 1};
  const auto quantile = [&](double share) {
    const auto nth = valid.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(valid.size() - 1));
    std::nth_element(valid.begin(), nth, valid.end());
    return static_cast<double>(*nth);
  };
  const double low = quantile(0.01), high = quantile(0.99);
  return high > low ? std::pair(low, high) : std::pair(low, low + 1e-6);
}

cv::Mat3b grey_picture(const cv::Mat& image, double full_scale) {
  cv::Mat grey, colours;
  image.convertTo(grey, CV_8U, 255 / full_scale);
  cv::cvtColor(grey, colours, cv::COLOR_GRAY2BGR);
  return colours;
}

cv::Mat3b match_picture(const Keyframe& reference, const FrameResult& current) {
  cv::Mat3b picture;
  cv::hconcat(grey_picture(reference.frame.texture, 160), grey_picture(current.frame.texture, 160), picture);
  const double shift = reference.frame.texture.cols;
  const std::shared_ptr<const Landmarks> landmarks = reference.landmarks.get();
  const std::vector<Keypoint>& earlier = landmarks->keypoints.keypoints;
  // Draw outliers first, so that they never hide an inlier.
  for (const char wanted : {char{0}, char{1}}) {
    for (size_t i = 0; i < current.matches.size(); ++i) {
      if (current.registration.motion.is_inlier[i] != wanted) continue;
      const Eigen::Vector2d p = earlier[static_cast<size_t>(current.matches[i].earlier)].pixel;
      const Eigen::Vector2d c = current.keypoints.keypoints[static_cast<size_t>(current.matches[i].current)].pixel;
      const cv::Point2d from(p.x(), p.y()), to(c.x() + shift, c.y());
      const cv::Scalar colour = wanted ? kGreen : kRed;
      cv::line(picture, from, to, colour, 1, cv::LINE_AA);
      cv::circle(picture, from, 2, colour, cv::FILLED, cv::LINE_AA);
      cv::circle(picture, to, 2, colour, cv::FILLED, cv::LINE_AA);
    }
  }
  return picture;
}

cv::Mat3b warm_picture(const cv::Mat1b& texture, const ThermalView& thermal) {
  constexpr double kSpan_k = 15;
  const cv::Mat1f& temperature_c = thermal.temperature_c;
  cv::Mat3b picture = grey_picture(texture, 160);
  const double low = thermal.warm.surroundings_c - 0.2 * kSpan_k;
  const cv::Mat3b colours = false_colour(temperature_c, low, low + 1.2 * kSpan_k);
  cv::Mat3b mixed;
  cv::addWeighted(picture, 0.4, colours, 0.6, 0, mixed);
  mixed.copyTo(picture, temperature_c == temperature_c);
  for (const WarmRegion& region : thermal.warm.list) {
    if (region.kind == WarmKind::too_small) continue;
    const cv::Scalar colour = region.candidate() ? kRed : kYellow;
    cv::rectangle(picture, region.box, colour, region.candidate() ? 2 : 1);
    put_text(picture, to_string(region.kind), {region.box.x, std::max(10, region.box.y - 3)}, 0.38);
  }
  return picture;
}

cv::Mat3b map_picture(const std::vector<CloudPoint>& points, const std::vector<Pose>& world_from_camera, cv::Size size,
                      const std::vector<CloudPoint>* framed) {
  cv::Mat3b picture(size, cv::Vec3b(24, 22, 20));
  if (points.empty() || world_from_camera.empty()) return picture;
  const Pose view = world_from_camera.front().inverse();
  std::vector<Eigen::Vector3d> seen;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9), high = -low;
  for (const CloudPoint& point : points) seen.push_back(view * point.position_m.cast<double>());
  for (const CloudPoint& point : framed ? *framed : points) {
    const Eigen::Vector2d at = (view * point.position_m.cast<double>()).head<2>();
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  const Eigen::Vector2d extent = high - low;
  const double scale = 0.94 * std::min(size.width / extent.x(), size.height / extent.y());  // px per m
  const auto to_pixel = [&](const Eigen::Vector3d& p) {
    return cv::Point2d(size.width / 2.0 + (p.x() - low.x() - extent.x() / 2) * scale,
                       size.height / 2.0 + (p.y() - low.y() - extent.y() / 2) * scale);
  };
  const int splat = std::max(1, static_cast<int>(std::ceil(0.0011 * scale)));
  cv::Mat1f nearest(size, 1e9f);
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d normal = view.rotation * points[i].normal.cast<double>();
    const double shade = 0.25 + 0.75 * std::max(0.0, normal.dot(Eigen::Vector3d(-0.35, -0.45, -0.82)));
    const double grey = std::min(255.0, 2.2 * points[i].grey * shade);
    const cv::Vec3b colour(static_cast<uchar>(0.82 * grey), static_cast<uchar>(0.92 * grey), static_cast<uchar>(grey));
    const cv::Point corner = to_pixel(seen[i]);
    for (int dy = 0; dy < splat; ++dy) {
      for (int dx = 0; dx < splat; ++dx) {
        const cv::Point at(corner.x + dx, corner.y + dy);
        if (at.x < 0 || at.y < 0 || at.x >= size.width || at.y >= size.height) continue;
        const auto depth = static_cast<float>(seen[i].z());
        if (depth >= nearest(at)) continue;
        nearest(at) = depth;
        picture(at) = colour;
      }
    }
  }
  for (size_t k = 0; k < world_from_camera.size(); ++k) {
    const cv::Point at = to_pixel(view * world_from_camera[k].translation);
    if (k > 0) cv::line(picture, to_pixel(view * world_from_camera[k - 1].translation), at, kYellow, 1, cv::LINE_AA);
    cv::circle(picture, at, 4, kYellow, cv::FILLED, cv::LINE_AA);
  }
  const int bar = static_cast<int>(0.05 * scale);
  cv::line(picture, {12, size.height - 14}, {12 + bar, size.height - 14}, kInk, 2);
  put_text(picture, "50 mm", {16 + bar, size.height - 9}, 0.45);
  return picture;
}

cv::Mat3b text_picture(const std::vector<std::string>& lines, cv::Size size) {
  cv::Mat3b picture(size, cv::Vec3b(24, 22, 20));
  int y = 28;
  for (const std::string& line : lines) {
    put_text(picture, line, {14, y}, 0.52);
    y += 24;
  }
  return picture;
}

cv::Mat3b sheet(const std::vector<std::vector<Panel>>& rows, cv::Size cell) {
  constexpr int kGap = 8, kTitle = 26;
  int columns = 1;
  for (const auto& row : rows) {
    int count = 0;
    for (const Panel& panel : row) count += panel.columns;
    columns = std::max(columns, count);
  }
  const int height = static_cast<int>(rows.size()) * (cell.height + kTitle + kGap) + kGap;
  cv::Mat3b paper(height, columns * (cell.width + kGap) + kGap);
  paper.setTo(kPaper);
  int y = kGap;
  for (const auto& row : rows) {
    int x = kGap;
    for (const Panel& panel : row) {
      const int width = panel.columns * (cell.width + kGap) - kGap;
      put_text(paper, panel.title, {x + 2, y + 18}, 0.55);
      if (!panel.picture.empty()) {
        const double scale = std::min(static_cast<double>(width) / panel.picture.cols,
                                      static_cast<double>(cell.height) / panel.picture.rows);
        cv::Mat scaled;
        cv::resize(panel.picture, scaled, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
        const cv::Rect at(x + (width - scaled.cols) / 2, y + kTitle + (cell.height - scaled.rows) / 2, scaled.cols,
                          scaled.rows);
        scaled.copyTo(paper(at & cv::Rect(0, 0, paper.cols, paper.rows)));
      }
      x += width + kGap;
    }
    y += cell.height + kTitle + kGap;
  }
  return paper;
}

}  // namespace fringeslam::tools
