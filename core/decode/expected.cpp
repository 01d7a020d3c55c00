// SPDX-License-Identifier: Apache-2.0
// Prior knowledge of a pixel's projector coordinate (docs/method.md, section 3.2: geometric and predicted).
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/decode/coordinate_of_depth.h"
#include "core/decode/decode.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

CoordinatePrior empty_prior(cv::Size size) {
  return {cv::Mat1f(size, kNaN), cv::Mat1f(size, 0.0f), cv::Mat1f(size, 0.0f)};
}

class CoordinateOfDepth {
 public:
  CoordinateOfDepth(const RigModel& rig, Axis axis) : rig_(rig), axis_(axis) {}

  // Returns NaN for points behind the projector.
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

// Projector parameters for the kernel, where a is the normalised coordinate that is coded: x for columns, y for rows.
// The equations are the same with x and y, and p1 and p2, exchanged.
struct CoordinateKernel {
  float a[4], b[4], z[4];  // rows of projector_from_camera
  float f, centre, k1, k2, k3, across, along;

  CoordinateKernel(const RigModel& rig, Axis axis) {
    const bool columns = axis == Axis::columns;
    const Pinhole& lens = rig.projector;
    const Pose& pose = rig.projector_from_camera;
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d column = i < 3 ? Eigen::Vector3d(pose.rotation.col(i)) : pose.translation;
      a[i] = static_cast<float>(column[columns ? 0 : 1]);
      b[i] = static_cast<float>(column[columns ? 1 : 0]);
      z[i] = static_cast<float>(column[2]);
    }
    f = static_cast<float>(columns ? lens.fx : lens.fy);
    centre = static_cast<float>(columns ? lens.cx : lens.cy);
    k1 = static_cast<float>(lens.distortion.k1);
    k2 = static_cast<float>(lens.distortion.k2);
    k3 = static_cast<float>(lens.distortion.k3);
    across = static_cast<float>(columns ? lens.distortion.p1 : lens.distortion.p2);
    along = static_cast<float>(columns ? lens.distortion.p2 : lens.distortion.p1);
  }
};

// Projector coordinates of depths and their derivatives with respect to depth.
FRINGESLAM_INLINE void coordinate_body(CoordinateKernel p, const cv::Vec2f* rays, const float* depth, int width,
                                       float* coordinate, float* per_m) {
  const float* ray = &rays[0][0];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float x = ray[2 * i], y = ray[2 * i + 1];
    const float slope_a = p.a[0] * x + p.a[1] * y + p.a[2], slope_b = p.b[0] * x + p.b[1] * y + p.b[2],
                slope_z = p.z[0] * x + p.z[1] * y + p.z[2];
    const float z = depth[i] * slope_z + p.z[3], per_z = 1 / z;
    const float a = (depth[i] * slope_a + p.a[3]) * per_z, b = (depth[i] * slope_b + p.b[3]) * per_z;
    const float da = (slope_a - a * slope_z) * per_z, db = (slope_b - b * slope_z) * per_z;  // derivatives w.r.t. depth
    const float r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
    const float radial_slope = p.k1 + r2 * (2 * p.k2 + r2 * 3 * p.k3);  // derivative w.r.t. r2
    const float by_a = radial + 2 * a * a * radial_slope + 2 * p.across * b + 6 * p.along * a;
    const float by_b = 2 * a * b * radial_slope + 2 * p.across * a + 2 * p.along * b;
    const float u = p.f * (a * radial + 2 * p.across * a * b + p.along * (r2 + 2 * a * a)) + p.centre;
    const bool before = z > 0;  // false for NaN
    coordinate[i] = before ? u : kNaN;
    per_m[i] = before ? p.f * (by_a * da + by_b * db) : kNaN;
  }
}

}  // namespace

DepthCoordinate coordinate_of_depth(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m, Axis axis) {
  static const auto coordinates = Variants<coordinate_body>::of(selected_instruction_set());
  DepthCoordinate result{cv::Mat1f(rays.size()), cv::Mat1f(rays.size())};
  const CoordinateKernel kernel(rig, axis);
  for_each_row(rays.rows, [&](int row) {
    coordinates(kernel, rays[row], depth_m[row], rays.cols, result.coordinate_px[row], result.per_m[row]);
  });
  return result;
}

CoordinatePrior predict_coordinate(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                                   const cv::Mat1f& sigma_m, Axis axis) {
  DepthCoordinate of_depth = coordinate_of_depth(rig, rays, depth_m, axis);
  CoordinatePrior expected{of_depth.coordinate_px, cv::Mat1f(rays.size(), 0.0f), of_depth.per_m};
  for_each_row(rays.rows, [&](int row) {
    float* sigma_px = expected.sigma_px[row];
    for (int col = 0; col < rays.cols; ++col) sigma_px[col] = std::abs(sigma_px[col]) * sigma_m(row, col);
  });
  return expected;
}

CoordinatePrior coordinate_bounds(const RigModel& rig, const PixelRays& rays, Axis axis) {
  CoordinatePrior expected = empty_prior(rays.size());
  const CoordinateOfDepth coordinate(rig, axis);
  const double first = -0.5, last = (axis == Axis::columns ? rig.projector.width : rig.projector.height) - 0.5;
  for_each_row(rays.rows, [&](int row) {
    for (int col = 0; col < rays.cols; ++col) {
      const double near = coordinate(rays(row, col), rig.near_m), far = coordinate(rays(row, col), rig.far_m);
      if (std::isnan(near) || std::isnan(far)) continue;
      const double low = std::max(first, std::min(near, far)), high = std::min(last, std::max(near, far));
      if (high < low) continue;  // the ray is outside the projector's field over the whole range
      expected.coordinate_px(row, col) = static_cast<float>(0.5 * (low + high));
      expected.half_width_px(row, col) = static_cast<float>(0.5 * (high - low));
    }
  });
  return expected;
}

}  // namespace fringeslam
