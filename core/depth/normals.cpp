// SPDX-License-Identifier: Apache-2.0
#include "core/depth/normals.h"

#include <cmath>
#include <limits>

#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// A fitted window: the plane through its centre's point.
struct Plane {
  cv::Vec3f normal, point_m;
  float offset_m = 0;     // normal . point
  float variance_m2 = 0;  // of the point, along the normal
};

class NormalEstimator {
 public:
  NormalEstimator(const cv::Mat3f& points, const PixelRays& rays, const cv::Mat1f& sigma, const PlaneFit& widest)
      : points_(points), relative_sigma_(points.size()), widest_(widest), image_(points, rays, sigma, widest.radius) {
    for_each_row(points.rows, [&](int row) {
      for (int col = 0; col < points.cols; ++col) relative_sigma_(row, col) = sigma(row, col) / points(row, col)[2];
    });
  }

  cv::Mat3f estimate() const {
    cv::Mat3f normals(points_.size(), cv::Vec3f::all(kNaN));
    cv::Mat3f fitted(points_.size());
    cv::Mat1b wanted = measured();
    for (PlaneFit fit = widest_; fit.radius >= 1; fit.radius /= 2) {
      for_each_row(points_.rows, [&](int row) {
        fit_planes(image_, row, fit, wanted[row], fitted[row]);
        for (int col = 0; col < points_.cols; ++col) {
          if (!std::isnan(fitted(row, col)[2])) normals(row, col) = fitted(row, col), wanted(row, col) = 0;
        }
      });
      for_each_row(points_.rows, [&](int row) {
        for (int col = 0; col < points_.cols; ++col) {
          if (wanted(row, col) == 0) continue;
          normals(row, col) = adopt(fitted, row, col, fit.radius);
          wanted(row, col) = std::isnan(normals(row, col)[2]);
        }
      });
    }
    return normals;
  }

 private:
  cv::Mat1b measured() const {
    cv::Mat1b measured(points_.size());
    for_each_row(points_.rows, [&](int row) {
      for (int col = 0; col < points_.cols; ++col) measured(row, col) = !std::isnan(points_(row, col)[2]);
    });
    return measured;
  }

  // Depth noise moves a point along its ray, and by this much of it along the normal.
  float variance_m2(float along_normal_m, int row, int col) const {
    const float sigma_m = along_normal_m * relative_sigma_(row, col);
    return sigma_m * sigma_m;
  }

  Plane plane_at(const cv::Mat3f& fitted, int row, int col) const {
    const cv::Vec3f& normal = fitted(row, col);
    const float offset_m = normal.dot(points_(row, col));
    return {normal, points_(row, col), offset_m, variance_m2(offset_m, row, col)};
  }

  // Squared distance of a pixel's point from a plane, and the variance of that by the noise of both.
  struct Distance {
    float square_m2 = 0, variance_m2 = 0;
    bool within(float sigmas) const { return square_m2 <= sigmas * sigmas * variance_m2; }  // false for NaN
  };
  Distance distance(const Plane& plane, int row, int col) const {
    const float off = plane.normal.dot(points_(row, col) - plane.point_m);
    return {off * off, variance_m2(plane.offset_m + off, row, col) + plane.variance_m2};
  }

  // True when the pixel's four neighbours lie on the plane, too: then the pixel itself holds no edge.
  bool inside_plane(const Plane& plane, int row, int col) const {
    constexpr float kMaxSigmas = 4.5;
    if (row < 1 || col < 1 || row + 1 >= points_.rows || col + 1 >= points_.cols) return false;
    return distance(plane, row - 1, col).within(kMaxSigmas) && distance(plane, row + 1, col).within(kMaxSigmas) &&
           distance(plane, row, col - 1).within(kMaxSigmas) && distance(plane, row, col + 1).within(kMaxSigmas);
  }

  // The normal of the window centred `radius` px away, in the best of eight directions, whose plane holds this
  // pixel's point and its neighbours within the noise.
  cv::Vec3f adopt(const cv::Mat3f& fitted, int row, int col, int radius) const {
    cv::Vec3f best = cv::Vec3f::all(kNaN);
    float best_sigmas2 = 2.5f * 2.5f;
    for (int direction = 0; direction < 9; ++direction) {
      const int r = row + (direction / 3 - 1) * radius, c = col + (direction % 3 - 1) * radius;
      if (r < 0 || c < 0 || r >= points_.rows || c >= points_.cols || std::isnan(fitted(r, c)[2])) continue;
      const Plane plane = plane_at(fitted, r, c);
      const Distance off = distance(plane, row, col);
      const float sigmas2 = off.square_m2 / off.variance_m2;
      if (sigmas2 < best_sigmas2 && inside_plane(plane, row, col)) best = plane.normal, best_sigmas2 = sigmas2;
    }
    return best;
  }

  const cv::Mat3f& points_;
  cv::Mat1f relative_sigma_;  // sigma / depth
  PlaneFit widest_;
  FitImage image_;
};

}  // namespace

cv::Mat3f estimate_normals(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m,
                           const PlaneFit& widest) {
  return NormalEstimator(points_m, rays, sigma_m, widest).estimate();
}

}  // namespace fringeslam
