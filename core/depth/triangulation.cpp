// SPDX-License-Identifier: Apache-2.0
#include "core/depth/triangulation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

constexpr int kDegree = Triangulation::kDegree;
constexpr int kNodes = kDegree + 1;
constexpr double kMarginPx = 2;    // beyond the projector's border, to allow for noise
constexpr float kBeyond = 1.001f;  // limit of |s| up to which a polynomial is extrapolated

// Projector coordinate of the point on a ray at a given inverse depth.
struct RayCoordinate {
  const RigModel& rig;
  Axis axis;
  Eigen::Vector3d direction;

  // Returns NaN for points behind the projector.
  double operator()(double inverse_depth) const {
    const Eigen::Vector3d point = direction + inverse_depth * rig.projector_from_camera.translation;
    if (!(point.z() > 0)) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d pixel = rig.projector.project(point);
    return axis == Axis::columns ? pixel.x() : pixel.y();
  }
};

struct Polynomial {
  std::array<double, kNodes> coefficients{};
  double centre = 0, half_range = 0;
};

// Moves one end of the inverse depth interval to the point where the ray leaves the projector's field, by the secant
// method. `inside` is the other end.
double clipped(const RayCoordinate& coordinate, double end, double inside, double low_px, double high_px) {
  const double u_end = coordinate(end);
  if (u_end >= low_px && u_end <= high_px) return end;
  const double target = u_end < low_px ? low_px : high_px;
  double a = end, b = inside, u_a = u_end - target, u_b = coordinate(inside) - target;
  for (int iteration = 0; iteration < 12 && u_a != u_b; ++iteration) {
    const double next = a - u_a * (b - a) / (u_b - u_a);
    b = std::exchange(a, next);
    u_b = std::exchange(u_a, coordinate(a) - target);
    if (std::abs(u_a) < 1e-3) break;
  }
  return a;
}

// Newton interpolation with divided differences at Chebyshev nodes of inverse depth, expanded into powers of s.
Polynomial interpolate(const RayCoordinate& coordinate, double w_low, double w_high) {
  Polynomial result;
  const double u_low = coordinate(w_low), u_high = coordinate(w_high);
  result.centre = 0.5 * (u_low + u_high);
  result.half_range = 0.5 * std::abs(u_high - u_low);
  std::array<double, kNodes> s, table;
  for (int i = 0; i < kNodes; ++i) {
    const double w = 0.5 * (w_low + w_high) + 0.5 * (w_high - w_low) * std::cos(std::numbers::pi * (i + 0.5) / kNodes);
    s[i] = (coordinate(w) - result.centre) / result.half_range;
    table[i] = w;
  }
  for (int order = 1; order < kNodes; ++order) {
    for (int i = kNodes - 1; i >= order; --i) table[i] = (table[i] - table[i - 1]) / (s[i] - s[i - order]);
  }
  for (int i = kNodes - 1; i >= 0; --i) {
    for (int k = kDegree; k > 0; --k)
      result.coefficients[k] = result.coefficients[k - 1] - s[i] * result.coefficients[k];
    result.coefficients[0] = table[i] - s[i] * result.coefficients[0];
  }
  return result;
}

struct TriangulationRow {
  std::array<const float*, kNodes> coefficients;
  const float *centre, *per_px;
  float near_m, far_m, max_sigma_m;
};

FRINGESLAM_INLINE void row_body(const TriangulationRow& t, int width, const float* coordinate, const float* sigma_px,
                                float* depth, float* sigma) {
  const float *c0 = t.coefficients[0], *c1 = t.coefficients[1], *c2 = t.coefficients[2], *c3 = t.coefficients[3],
              *c4 = t.coefficients[4], *c5 = t.coefficients[5];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float s = (coordinate[i] - t.centre[i]) * t.per_px[i];
    const float w = c0[i] + s * (c1[i] + s * (c2[i] + s * (c3[i] + s * (c4[i] + s * c5[i]))));
    const float slope = c1[i] + s * (2 * c2[i] + s * (3 * c3[i] + s * (4 * c4[i] + s * (5 * c5[i]))));
    const float z = 1 / w;
    const float spread = z * z * std::abs(slope * t.per_px[i]) * sigma_px[i];
    const bool valid = (std::abs(s) <= kBeyond) & (z >= t.near_m) & (z <= t.far_m) & (spread <= t.max_sigma_m);
    depth[i] = valid ? z : kNaN;
    sigma[i] = valid ? spread : kNaN;
  }
}

FRINGESLAM_INLINE int near(float a, float b, float limit) { return std::abs(a - b) <= limit; }  // 0 for NaN

FRINGESLAM_INLINE void points_body(const DepthRows& rows, int width, float per_depth, float* depth, cv::Vec3f* points,
                                   float* sigma) {
  const float *above = rows.above, *here = rows.here, *below = rows.below;
  // The ends of the row have only one neighbour.
  const auto kept = [&](int i, int left, int right) {
    const float limit = per_depth * here[i] + 6 * rows.sigma[i];
    const int along_row =
        (left & near(here[i], here[i - left], limit)) | (right & near(here[i], here[i + right], limit));
    const int along_column = near(here[i], above[i], limit) | near(here[i], below[i], limit);
    depth[i] = along_row & along_column ? here[i] : kNaN;
    sigma[i] = along_row & along_column ? rows.sigma[i] : kNaN;
  };
#pragma GCC ivdep
  for (int i = 1; i < width - 1; ++i) kept(i, 1, 1);
  kept(0, 0, width > 1);
  kept(width - 1, width > 1, 0);
  const float* rays = &rows.rays[0][0];
  float* xyz = &points[0][0];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float z = depth[i];
    xyz[3 * i] = z * rays[2 * i];
    xyz[3 * i + 1] = z * rays[2 * i + 1];
    xyz[3 * i + 2] = z;
  }
}

}  // namespace

Triangulation::Triangulation(const RigModel& rig, const PixelRays& rays, double near_m, double far_m, Axis axis)
    : rays_(rays), near_m_(near_m), far_m_(far_m), pixel_angle_(1 / rig.camera.fx) {
  if (!(near_m < far_m))
    throw Error("depth.near_m is " + to_text(near_m) + " but depth.far_m is " + to_text(far_m) +
                "; near_m must be smaller than far_m");
  for (cv::Mat1f& plane : coefficients_) plane = cv::Mat1f(rays.size(), kNaN);
  centre_ = cv::Mat1f(rays.size(), kNaN);
  per_px_ = cv::Mat1f(rays.size(), kNaN);
  const double low_px = -0.5 - kMarginPx;
  const double high_px = (axis == Axis::columns ? rig.projector.width : rig.projector.height) - 0.5 + kMarginPx;
  const double w_far = 0.999 / far_m, w_near = 1.001 / near_m;
  for_each_row(rays.rows, [&](int row) {
    for (int col = 0; col < rays.cols; ++col) {
      const cv::Vec2f ray = rays(row, col);
      const RayCoordinate coordinate{rig, axis,
                                     rig.projector_from_camera.rotation * Eigen::Vector3d(ray[0], ray[1], 1)};
      const double u_far = coordinate(w_far), u_near = coordinate(w_near);
      const bool crosses = std::max(u_far, u_near) > low_px && std::min(u_far, u_near) < high_px;
      if (!crosses) continue;  // also for NaN
      const Polynomial polynomial = interpolate(coordinate, clipped(coordinate, w_far, w_near, low_px, high_px),
                                                clipped(coordinate, w_near, w_far, low_px, high_px));
      for (int k = 0; k < kNodes; ++k) coefficients_[k](row, col) = static_cast<float>(polynomial.coefficients[k]);
      centre_(row, col) = static_cast<float>(polynomial.centre);
      per_px_(row, col) = static_cast<float>(1 / polynomial.half_range);
    }
  });
}

void Triangulation::row(int row, const float* coordinate_px, const float* sigma_px, float max_sigma_m, float* depth_m,
                        float* sigma_m, InstructionSet set) const {
  TriangulationRow t{{},         centre_[row], per_px_[row], static_cast<float>(near_m_), static_cast<float>(far_m_),
                     max_sigma_m};
  for (size_t k = 0; k < kNodes; ++k) t.coefficients[k] = coefficients_[k][row];
  const int width = rays_.cols;
  Variants<row_body>::of(set)(t, width, coordinate_px, sigma_px, depth_m, sigma_m);
}

void points_row(const DepthRows& rows, int width, float per_depth, float* depth, cv::Vec3f* points, float* sigma,
                InstructionSet set) {
  Variants<points_body>::of(set)(rows, width, per_depth, depth, points, sigma);
}

}  // namespace fringeslam
