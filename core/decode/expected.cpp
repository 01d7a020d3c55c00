// SPDX-License-Identifier: Apache-2.0
// What is known of a pixel's projector coordinate beforehand (METHOD S3, geometric and predicted).
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/decode/decode.h"
#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

ExpectedCoordinate nothing_expected(cv::Size size) {
  return {cv::Mat1f(size, kNaN), cv::Mat1f(size, 0.0f), cv::Mat1f(size, 0.0f)};
}

class CoordinateOfDepth {
 public:
  CoordinateOfDepth(const RigModel& rig, Axis axis) : rig_(rig), axis_(axis) {}

  // NaN behind the projector.
  double operator()(const cv::Vec2f& ray, double depth_m) const {
    const Eigen::Vector3d point = rig_.projector_from_camera * (depth_m * Eigen::Vector3d(ray[0], ray[1], 1));
    if (!(point.z() > 0)) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d pixel = rig_.projector.project(point);
    return axis_ == Axis::columns ? pixel.x() : pixel.y();
  }

 private:
  const RigModel& rig_;
  Axis axis_;
};

}  // namespace

ExpectedCoordinate expected_coordinate(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                                       const cv::Mat1f& sigma_m, Axis axis) {
  ExpectedCoordinate expected = nothing_expected(rays.size());
  const CoordinateOfDepth coordinate(rig, axis);
  for_each_row(rays.rows, [&](int row) {
    for (int col = 0; col < rays.cols; ++col) {
      const double depth = depth_m(row, col), sigma = sigma_m(row, col);
      const double low = coordinate(rays(row, col), depth - sigma), high = coordinate(rays(row, col), depth + sigma);
      expected.coordinate_px(row, col) = static_cast<float>(coordinate(rays(row, col), depth));
      expected.sigma_px(row, col) = static_cast<float>(0.5 * std::abs(high - low));
    }
  });
  return expected;
}

ExpectedCoordinate coordinate_bounds(const RigModel& rig, const PixelRays& rays, Axis axis) {
  ExpectedCoordinate expected = nothing_expected(rays.size());
  const CoordinateOfDepth coordinate(rig, axis);
  const double first = -0.5, last = (axis == Axis::columns ? rig.projector.width : rig.projector.height) - 0.5;
  for_each_row(rays.rows, [&](int row) {
    for (int col = 0; col < rays.cols; ++col) {
      const double near = coordinate(rays(row, col), rig.near_m), far = coordinate(rays(row, col), rig.far_m);
      if (std::isnan(near) || std::isnan(far)) continue;
      const double low = std::max(first, std::min(near, far)), high = std::min(last, std::max(near, far));
      if (high < low) continue;  // the ray is out of the beam all along the range
      expected.coordinate_px(row, col) = static_cast<float>(0.5 * (low + high));
      expected.half_width_px(row, col) = static_cast<float>(0.5 * (high - low));
    }
  });
  return expected;
}

}  // namespace fringeslam
