// SPDX-License-Identifier: Apache-2.0
#include "core/depth/depth.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/types/error.h"
#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Largest depth step between neighbours that still is one surface: the footprint of a pixel on a
// surface of the limiting slope, plus what noise can do.
struct StepLimit {
  double per_depth = 0;
  double operator()(double depth, double sigma) const { return per_depth * depth + 6 * sigma; }
};

// Normals by planes that fit windows. Under perspective a plane n.P = d is linear in inverse depth,
// 1/z = (n/d).(x, y, 1), so a fit is a 3 x 3 linear system.
//
// Registration multiplies this normal with this pixel's residual, and three things would bias it. A normal
// rounded over an edge: a window that does not look like a plane within the noise gives none. A normal that
// knows the pixel's own noise: a window holds only pairs of pixels that mirror each other, which gives the
// pixel itself no say in the slopes. And the noise of small windows: near an edge a pixel first takes the
// normal of a wider window beside it whose plane it lies on; only then are smaller windows tried.
class NormalEstimator {
 public:
  NormalEstimator(const cv::Mat3f& points, const PixelRays& rays, const cv::Mat1f& sigma, StepLimit limit,
                  const DepthOptions& options)
      : points_(points), rays_(rays), sigma_(sigma), limit_(limit), max_chi2_(options.max_normal_chi2) {}

  cv::Mat3f estimate(int largest_radius) const {
    cv::Mat3f normals(points_.size(), cv::Vec3f::all(kNaN));
    for (int radius = largest_radius; radius >= 1; radius /= 2) {
      cv::Mat3f fitted(points_.size(), cv::Vec3f::all(kNaN));
      const auto fill = [&](cv::Mat3f& target, const auto& normal_at) {
        for_each_row(points_.rows, [&](int row) {
          for (int col = 0; col < points_.cols; ++col) {
            if (!std::isnan(points_(row, col)[2]) && std::isnan(normals(row, col)[2]))
              target(row, col) = normal_at(row, col);
          }
        });
      };
      fill(fitted, [&](int row, int col) { return fit(row, col, radius); });
      fitted.copyTo(normals, has_normal(fitted));
      fill(normals, [&](int row, int col) { return adopt(fitted, row, col, radius); });
    }
    return normals;
  }

 private:
  // Sums of the normal equations, coordinates and inverse depths relative to the centre pixel.
  struct Sums {
    double xx = 0, xy = 0, yy = 0, x = 0, y = 0, w = 0, xw = 0, yw = 0, ww = 0;
    int count = 1;  // the centre itself, at the origin
    void add(double dx, double dy, double dw) {
      xx += dx * dx, xy += dx * dy, yy += dy * dy, x += dx, y += dy;
      w += dw, xw += dx * dw, yw += dy * dw, ww += dw * dw;
      ++count;
    }
  };

  static cv::Mat1b has_normal(const cv::Mat3f& normals) {
    cv::Mat1f z;
    cv::extractChannel(normals, z, 2);
    cv::Mat1b known;
    cv::compare(z, z, known, cv::CMP_EQ);
    return known;
  }

  // Distance of one pixel's point from the plane through another's, in sigmas of the two.
  double sigmas_off_plane(const cv::Vec3f& normal, int row, int col, int plane_row, int plane_col) const {
    const cv::Vec3f& point = points_(row, col);
    const cv::Vec3f& origin = points_(plane_row, plane_col);
    const double own = normal.dot(point) / point[2] * sigma_(row, col);
    const double other = normal.dot(origin) / origin[2] * sigma_(plane_row, plane_col);
    return std::abs(normal.dot(point - origin)) / std::hypot(own, other);
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

  cv::Vec3f fit(int row, int col, int radius) const {
    const double z0 = points_(row, col)[2];
    const cv::Vec2f ray0 = rays_(row, col);
    const double step = limit_(z0, sigma_(row, col));
    Sums s;
    for (int dr = 0; dr <= radius; ++dr) {
      for (int dc = dr == 0 ? 1 : -radius; dc <= radius; ++dc) {
        const int r1 = row + dr, c1 = col + dc, r2 = row - dr, c2 = col - dc;
        if (std::min({r1, c1, r2, c2}) < 0 || std::max(r1, r2) >= points_.rows || std::max(c1, c2) >= points_.cols)
          continue;
        const double z1 = points_(r1, c1)[2], z2 = points_(r2, c2)[2];
        const double reach = step * std::max(dr, std::abs(dc));
        if (!(std::abs(z1 - z0) <= reach && std::abs(z2 - z0) <= reach)) continue;
        s.add(rays_(r1, c1)[0] - ray0[0], rays_(r1, c1)[1] - ray0[1], 1 / z1 - 1 / z0);
        s.add(rays_(r2, c2)[0] - ray0[0], rays_(r2, c2)[1] - ray0[1], 1 / z2 - 1 / z0);
      }
    }
    const int window = (2 * radius + 1) * (2 * radius + 1);
    if (s.count * 2 < window) return {kNaN, kNaN, kNaN};
    Eigen::Matrix3d normal_matrix;
    normal_matrix << s.xx, s.xy, s.x, s.xy, s.yy, s.y, s.x, s.y, s.count;
    const Eigen::Vector3d right_side(s.xw, s.yw, s.w);
    const Eigen::Vector3d abc = normal_matrix.inverse() * right_side;
    const double sigma_w = sigma_(row, col) / (z0 * z0);
    const double chi2 = (s.ww - abc.dot(right_side)) / (sigma_w * sigma_w * (s.count - 3));
    if (!(chi2 <= max_chi2_)) return {kNaN, kNaN, kNaN};
    // Back from coordinates relative to the centre: 1/z = a x + b y + (c + 1/z0 - a x0 - b y0).
    Eigen::Vector3d n(abc.x(), abc.y(), abc.z() + 1.0 / z0 - abc.x() * ray0[0] - abc.y() * ray0[1]);
    n.normalize();
    if (!n.allFinite()) return {kNaN, kNaN, kNaN};
    if (n.x() * ray0[0] + n.y() * ray0[1] + n.z() > 0) n = -n;
    return {static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z())};
  }

  const cv::Mat3f& points_;
  const PixelRays& rays_;
  const cv::Mat1f& sigma_;
  StepLimit limit_;
  double max_chi2_;
};

}  // namespace

cv::Mat1b depth_image(const cv::Mat3f& points_m, double near_m, double far_m) {
  cv::Mat1b image(points_m.size());
  for_each_row(points_m.rows, [&](int row) {
    for (int col = 0; col < points_m.cols; ++col) {
      const double z = points_m(row, col)[2];
      const double grey = std::clamp(std::round(255 * (far_m - z) / (far_m - near_m)), 1.0, 255.0);
      image(row, col) = std::isnan(z) ? uchar{0} : static_cast<uchar>(grey);
    }
  });
  return image;
}

namespace {

// A pixel measures the mean phase of its area, weighted by brightness. Where texture is finer than pixels nobody knows
// where in the area that is: an error in proportion to the depth's change over the pixel, of no weight beside the
// camera's noise but where surfaces are seen at a grazing angle.
cv::Mat1f with_footprint_noise(const Frame& frame, double share, StepLimit limit) {
  cv::Mat1f sigma = frame.sigma_m.clone();
  const auto per_px = static_cast<float>(share);
  for_each_row(frame.height(), [&](int row) {
    for (int col = 0; col < frame.width(); ++col) {
      const float z = frame.points_m(row, col)[2], own = sigma(row, col);
      if (std::isnan(z)) continue;
      const float most = static_cast<float>(limit(z, own));
      const auto change = [&](int r, int c) {
        if (r < 0 || c < 0 || r >= frame.height() || c >= frame.width()) return 0.0f;
        const float step = std::abs(frame.points_m(r, c)[2] - z);
        return step <= most ? step : 0.0f;  // 0 for NaN
      };
      const float across = std::max(change(row, col - 1), change(row, col + 1)),
                  along = std::max(change(row - 1, col), change(row + 1, col));
      sigma(row, col) = std::sqrt(own * own + per_px * per_px * (across * across + along * along));
    }
  });
  return sigma;
}

StepLimit step_limit(const Triangulation& triangulation, const DepthOptions& options) {
  return {std::tan(options.max_slope_deg * std::numbers::pi / 180) * triangulation.pixel_angle()};
}

}  // namespace

void triangulate(Frame& frame, const DecodedStack& decoded, const Triangulation& triangulation,
                 const DepthOptions& options, InstructionSet set) {
  const cv::Size size = decoded.coordinate_px.size();
  if (size != triangulation.size())
    throw Error("depth: the images are " + std::to_string(size.width) + "x" + std::to_string(size.height) +
                " but the rig's camera has " + std::to_string(triangulation.size().width) + "x" +
                std::to_string(triangulation.size().height));
  frame.index = decoded.index;
  frame.timestamp_s = decoded.timestamp_s;
  frame.points_m.create(size);
  frame.sigma_m.create(size);
  frame.texture.create(size);
  cv::Mat1f depth(size.height + 2, size.width), sigma(size);
  depth.row(0).setTo(kNaN);
  depth.row(size.height + 1).setTo(kNaN);
  const auto per_depth = static_cast<float>(step_limit(triangulation, options).per_depth);
  const auto max_sigma = static_cast<float>(options.max_sigma_m);
  const auto to_grey = static_cast<float>(255 / decoded.full_scale_dn);
  for_each_row(size.height, [&](int row) {
    triangulation.row(row, decoded.coordinate_px[row], decoded.sigma_px[row], max_sigma, depth[row + 1], sigma[row],
                      set);
    const float* mean = decoded.mean[row];
    for (int col = 0; col < size.width; ++col)
      frame.texture[row][col] = static_cast<uchar>(std::clamp(to_grey * mean[col] + 0.5f, 0.0f, 255.0f));
  });
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& range) {
    std::vector<float> kept(static_cast<size_t>(size.width));
    for (int row = range.start; row < range.end; ++row)
      points_row({depth[row], depth[row + 1], depth[row + 2], sigma[row], triangulation.rays()[row]}, size.width,
                 per_depth, kept.data(), frame.points_m[row], frame.sigma_m[row], set);
  });
}

Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const Triangulation& triangulation,
                  const DepthOptions& options) {
  check_options(options, "depth");
  Frame frame;
  triangulate(frame, decoded, triangulation, options);
  const StepLimit limit = step_limit(triangulation, options);
  frame.normals = NormalEstimator(frame.points_m, triangulation.rays(), frame.sigma_m, limit, options)
                      .estimate(options.normal_radius_px);
  frame.sigma_m = with_footprint_noise(frame, options.footprint_noise, limit);
  frame.depth_image = depth_image(frame.points_m, rig.near_m, rig.far_m);
  return frame;
}

Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const PixelRays& rays,
                  const DepthOptions& options) {
  check_options(options, "depth");
  return reconstruct(decoded, rig, Triangulation(rig, rays, options.near_m, options.far_m), options);
}

}  // namespace fringeslam
