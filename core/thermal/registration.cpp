// SPDX-License-Identifier: Apache-2.0
#include "core/thermal/registration.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Projects the points into the thermal camera: pixel and depth along its z axis; NaN behind the camera or outside the
// image.
cv::Mat3f seen_at(const cv::Mat3f& points_m, const ThermalCamera& thermal) {
  cv::Mat3f seen(points_m.size(), cv::Vec3f::all(kNaN));
  const double largest_r2 = thermal.lens.largest_r2();
  for_each_row(points_m.rows, [&](int row) {
    for (int col = 0; col < points_m.cols; ++col) {
      const cv::Vec3f& p = points_m(row, col);
      const Eigen::Vector3d point = thermal.thermal_from_camera * Eigen::Vector3f(p[0], p[1], p[2]).cast<double>();
      Eigen::Vector2d pixel;
      if (thermal.lens.shows(point, largest_r2, pixel)) seen(row, col) = cv::Vec3d(pixel.x(), pixel.y(), point.z());
    }
  });
  return seen;
}

int nearest(float coordinate, int size) { return std::clamp(static_cast<int>(std::lround(coordinate)), 0, size - 1); }

// Depth of the nearest point in each pixel of the thermal camera.
cv::Mat1f nearest_depth(const cv::Mat3f& seen, cv::Size size) {
  cv::Mat1f depth(size, std::numeric_limits<float>::infinity());
  for (const cv::Vec3f& s : seen) {
    if (!(s[2] > 0)) continue;
    float& least = depth(nearest(s[1], size.height), nearest(s[0], size.width));
    least = std::min(least, s[2]);
  }
  return depth;
}

float between_pixels(const cv::Mat1f& image, float x, float y) {
  const float u = std::clamp(x, 0.0f, static_cast<float>(image.cols - 1));
  const float v = std::clamp(y, 0.0f, static_cast<float>(image.rows - 1));
  const int col = std::min(static_cast<int>(u), std::max(0, image.cols - 2));
  const int row = std::min(static_cast<int>(v), std::max(0, image.rows - 2));
  const int right = std::min(col + 1, image.cols - 1), below = std::min(row + 1, image.rows - 1);
  const float a = u - static_cast<float>(col), b = v - static_cast<float>(row);
  return (1 - b) * ((1 - a) * image(row, col) + a * image(row, right)) +
         b * ((1 - a) * image(below, col) + a * image(below, right));
}

cv::Mat1f greatest_around(const cv::Mat1f& image, double radius_px) {
  const int r = static_cast<int>(std::ceil(radius_px));
  cv::Mat1f result;
  cv::dilate(image, result, cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * r + 1, 2 * r + 1}));
  return result;
}

}  // namespace

RegisteredThermal register_thermal(const cv::Mat3f& points_m, const cv::Mat1f& thermal_c, const RigModel& rig,
                                   const ThermalOptions& options) {
  if (!rig.thermal) throw Error("register_thermal: the rig has no thermal camera");
  const Pinhole& lens = rig.thermal->lens;
  if (thermal_c.size() != cv::Size(lens.width, lens.height))
    throw Error("register_thermal: the thermal image is " + std::to_string(thermal_c.cols) + "x" +
                std::to_string(thermal_c.rows) + ", the rig's thermal camera " + std::to_string(lens.width) + "x" +
                std::to_string(lens.height));
  const cv::Mat3f seen = seen_at(points_m, *rig.thermal);
  const cv::Mat1f nearest_m = nearest_depth(seen, thermal_c.size());
  const cv::Mat1f around_c = greatest_around(thermal_c, options.halo_px);
  const auto hidden_by_m = static_cast<float>(options.hidden_by_m);
  RegisteredThermal result{cv::Mat1f(points_m.size(), kNaN), cv::Mat1f(points_m.size(), kNaN)};
  for_each_row(points_m.rows, [&](int row) {
    for (int col = 0; col < points_m.cols; ++col) {
      const cv::Vec3f& s = seen(row, col);
      if (!(s[2] > 0)) continue;
      const int v = nearest(s[1], lens.height), u = nearest(s[0], lens.width);
      if (s[2] > nearest_m(v, u) + hidden_by_m) continue;
      result.temperature_c(row, col) = between_pixels(thermal_c, s[0], s[1]);
      result.around_c(row, col) = around_c(v, u);
    }
  });
  return result;
}

}  // namespace fringeslam
