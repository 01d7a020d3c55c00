// SPDX-License-Identifier: Apache-2.0
#include "core/depth/normals.h"

#include <cmath>
#include <limits>

#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

class NormalEstimator {
 public:
  NormalEstimator(const cv::Mat3f& points, const PixelRays& rays, const cv::Mat1f& sigma, const PlaneFit& widest)
      : points_(points), sigma_(sigma), widest_(widest), image_(points, rays, sigma, widest.radius) {}

  cv::Mat3f estimate() const {
    cv::Mat3f normals(points_.size(), cv::Vec3f::all(kNaN));
    cv::Mat3f fitted(points_.size());
    for (PlaneFit fit = widest_; fit.radius >= 1; fit.radius /= 2) {
      cv::Mat1b wanted = without_normal(normals);
      for_each_row(points_.rows, [&](int row) {
        fit_planes(image_, row, fit, wanted[row], fitted[row]);
        for (int col = 0; col < points_.cols; ++col) {
          if (!std::isnan(fitted(row, col)[2])) normals(row, col) = fitted(row, col), wanted(row, col) = 0;
        }
      });
      for_each_row(points_.rows, [&](int row) {
        for (int col = 0; col < points_.cols; ++col) {
          if (wanted(row, col) != 0) normals(row, col) = adopt(fitted, row, col, fit.radius);
        }
      });
    }
    return normals;
  }

 private:
  cv::Mat1b without_normal(const cv::Mat3f& normals) const {
    cv::Mat1b wanted(points_.size());
    for_each_row(points_.rows, [&](int row) {
      for (int col = 0; col < points_.cols; ++col)
        wanted(row, col) = !std::isnan(points_(row, col)[2]) && std::isnan(normals(row, col)[2]);
    });
    return wanted;
  }

  // Distance of one pixel's point from the plane through another's, in sigmas of the two.
  double sigmas_off_plane(const cv::Vec3f& normal, int row, int col, int plane_row, int plane_col) const {
    const cv::Vec3f& point = points_(row, col);
    const cv::Vec3f& origin = points_(plane_row, plane_col);
    const double own = normal.dot(point) / point[2] * sigma_(row, col);
    const double other = normal.dot(origin) / origin[2] * sigma_(plane_row, plane_col);
    return std::abs(normal.dot(point - origin)) / std::sqrt(own * own + other * other);
  }

  // True when the pixel's four neighbours lie on the plane, too: then the pixel itself holds no edge.
  bool inside_plane(const cv::Vec3f& normal, int row, int col, int plane_row, int plane_col) const {
    constexpr double kMaxSigmas = 4.5;
    if (row < 1 || col < 1 || row + 1 >= points_.rows || col + 1 >= points_.cols) return false;
    const auto on_plane = [&](int r, int c) {
      return sigmas_off_plane(normal, r, c, plane_row, plane_col) <= kMaxSigmas;  // false for NaN
    };
    return on_plane(row - 1, col) && on_plane(row + 1, col) && on_plane(row, col - 1) && on_plane(row, col + 1);
  }

  // The normal of the window centred `radius` px away, in the best of eight directions, whose plane holds this
  // pixel's point and its neighbours within the noise.
  cv::Vec3f adopt(const cv::Mat3f& fitted, int row, int col, int radius) const {
    cv::Vec3f best = cv::Vec3f::all(kNaN);
    double best_sigmas = 2.5;
    for (int direction = 0; direction < 9; ++direction) {
      const int r = row + (direction / 3 - 1) * radius, c = col + (direction % 3 - 1) * radius;
      if (r < 0 || c < 0 || r >= points_.rows || c >= points_.cols || std::isnan(fitted(r, c)[2])) continue;
      const cv::Vec3f normal = fitted(r, c);
      const double sigmas = sigmas_off_plane(normal, row, col, r, c);
      if (sigmas < best_sigmas && inside_plane(normal, row, col, r, c)) best = normal, best_sigmas = sigmas;
    }
    return best;
  }

  const cv::Mat3f& points_;
  const cv::Mat1f& sigma_;
  PlaneFit widest_;
  FitImage image_;
};

}  // namespace

cv::Mat3f estimate_normals(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m,
                           const PlaneFit& widest) {
  return NormalEstimator(points_m, rays, sigma_m, widest).estimate();
}

}  // namespace fringeslam
