// SPDX-License-Identifier: Apache-2.0
#include "core/types/frame.h"

#include <array>
#include <cmath>
#include <limits>
#include <mutex>

#include "core/base/parallel.h"

namespace fringeslam {

cv::Vec3f neighbour_normal(const cv::Mat3f& points_m, int row, int col) {
  const cv::Vec3f& here = points_m(row, col);
  const auto at = [&](int r, int c) {
    const bool inside = r >= 0 && c >= 0 && r < points_m.rows && c < points_m.cols;
    return inside ? points_m(r, c) : cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
  };
  const auto nearer = [&](const cv::Vec3f& before, const cv::Vec3f& after) {
    const cv::Vec3f back = here - before, forth = after - here;
    return std::abs(back[2]) <= std::abs(forth[2]) || std::isnan(forth[2]) ? back : forth;
  };
  const cv::Vec3f normal = nearer(at(row, col - 1), at(row, col + 1)).cross(nearer(at(row - 1, col), at(row + 1, col)));
  return normal * ((normal.dot(here) > 0 ? -1.0f : 1.0f) / static_cast<float>(cv::norm(normal)));
}

namespace {

PixelRays computed_rays(const Pinhole& camera) {
  PixelRays rays(camera.height, camera.width);
  for_each_row(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector2d xy = camera.undistort({col, row});
      rays(row, col) = {static_cast<float>(xy.x()), static_cast<float>(xy.y())};
    }
  });
  return rays;
}

using CameraNumbers = std::array<double, 11>;

CameraNumbers numbers_of(const Pinhole& c) {
  const Distortion& d = c.distortion;
  return {static_cast<double>(c.width),
          static_cast<double>(c.height),
          c.fx,
          c.fy,
          c.cx,
          c.cy,
          d.k1,
          d.k2,
          d.p1,
          d.p2,
          d.k3};
}

}  // namespace

PixelRays pixel_rays(const Pinhole& camera) {
  // Most parts of a pipeline need the rays of the same camera, and they take a third of a microsecond per pixel.
  static std::mutex mutex;
  static CameraNumbers of{};
  static PixelRays known;
  const CameraNumbers numbers = numbers_of(camera);
  {
    const std::lock_guard lock(mutex);
    if (!known.empty() && numbers == of) return known;
  }
  PixelRays rays = computed_rays(camera);  // without the lock, because the loop may run tasks that need rays as well
  const std::lock_guard lock(mutex);
  known = rays;
  of = numbers;
  return rays;
}

}  // namespace fringeslam
