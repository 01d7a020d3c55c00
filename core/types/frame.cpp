// SPDX-License-Identifier: Apache-2.0
#include "core/types/frame.h"

#include <cmath>
#include <limits>

#include "core/base/last_result.h"
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

}  // namespace

PixelRays pixel_rays(const Pinhole& camera) {
  // Most parts of a pipeline need the rays of the same camera, and they take a third of a microsecond per pixel.
  static LastResult<Pinhole, PixelRays> last;
  return last.get(camera, [&] { return computed_rays(camera); });
}

}  // namespace fringeslam
