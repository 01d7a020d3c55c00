// SPDX-License-Identifier: Apache-2.0
#include "core/depth/triangulation.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/camera_pupil.h"
#include "core/types/error.h"
#include "core/types/options.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kDegree = Triangulation::kDegree;
constexpr int kNodes = kDegree + 1;
constexpr int kMarginPx = 2;       // beyond the projector's border, to allow for noise
constexpr float kBeyond = 1.001f;  // limit of |s| up to which a polynomial is extrapolated
// Errors of a polynomial, as errors of the coordinate: up to the first they are far below the noise of any fringes; beyond the
// second there is no depth.
constexpr double kNegligibleError_px = 1e-3, kLargestError_px = 0.5;

// Columns that are interpolated together, so that their arrays stay in the first-level cache.
constexpr int kBlock = 64;
using Block = std::array<double, kBlock>;

// The projector as a camera: "along" is the axis of the patterns.
struct Projection {
  double focal_px = 0, centre_px = 0, across_focal_px = 0, across_centre_px = 0;
  double k1 = 0, k2 = 0, k3 = 0, p_along = 0, p_across = 0;
  double t_along_m = 0, t_across_m = 0, t_depth_m = 0;
  double largest_r2 = 0;  // of the projector's image and its margin

  Projection(const RigModel& rig, Axis axis) {
    const Pinhole& projector = rig.projector;
    const Distortion& d = projector.distortion;
    const Eigen::Vector3d& t = rig.projector_from_camera.translation;
    const bool columns = axis == Axis::columns;
    focal_px = columns ? projector.fx : projector.fy;
    centre_px = columns ? projector.cx : projector.cy;
    across_focal_px = columns ? projector.fy : projector.fx;
    across_centre_px = columns ? projector.cy : projector.cx;
    k1 = d.k1, k2 = d.k2, k3 = d.k3;
    p_along = columns ? d.p2 : d.p1;
    p_across = columns ? d.p1 : d.p2;
    t_along_m = columns ? t.x() : t.y();
    t_across_m = columns ? t.y() : t.x();
    t_depth_m = t.z();
    Pinhole with_margin = projector;
    with_margin.width += 2 * kMarginPx, with_margin.height += 2 * kMarginPx;
    with_margin.cx += kMarginPx, with_margin.cy += kMarginPx;
    largest_r2 = with_margin.largest_r2();
  }
};

// Directions of rays in the projector's frame.
struct RayBlock {
  Block along, across, depth;
};

struct Lit {
  double along, across;  // projector coordinates, px
};

// Returns the projector coordinates of the point on a ray at a given inverse depth, as Pinhole::project() does; NaN behind the
// projector. Outside the projector's image, the distortion is that of its border, so that a polynomial that folds farther out
// does not map other points into the image.
FRINGESLAM_INLINE Lit lit_at(const Projection& p, const RayBlock& rays, int i, double inverse_depth) {
  const auto k = static_cast<size_t>(i);
  const double depth = rays.depth[k] + inverse_depth * p.t_depth_m;
  const double x = (rays.along[k] + inverse_depth * p.t_along_m) / depth;
  const double y = (rays.across[k] + inverse_depth * p.t_across_m) / depth;
  const double full_r2 = x * x + y * y;
  const double r2 = std::min(full_r2, p.largest_r2), inside = std::min(1.0, p.largest_r2 / full_r2);
  const double radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
  const double along = x * radial + inside * (2 * p.p_across * x * y + p.p_along * (full_r2 + 2 * x * x));
  const double across = y * radial + inside * (2 * p.p_along * x * y + p.p_across * (full_r2 + 2 * y * y));
  const double none = depth > 0 ? 0 : std::numeric_limits<double>::quiet_NaN();
  return {p.focal_px * along + p.centre_px + none, p.across_focal_px * across + p.across_centre_px + none};
}

FRINGESLAM_INLINE void coordinates_body(const Projection& p, const RayBlock& rays, const Block& inverse_depth,
                                        Block& coordinate) {
#pragma GCC ivdep
  for (int i = 0; i < kBlock; ++i)
    coordinate[static_cast<size_t>(i)] = lit_at(p, rays, i, inverse_depth[static_cast<size_t>(i)]).along;
}

// Moves one end of the inverse depth interval to the point where a coordinate leaves the projector's field, by the secant
// method on the coordinate times `scale`. `inside` is the other end; the coordinates there are u_end and u_inside.
template <class Coordinate, class Scale>
double clipped(const Coordinate& coordinate, const Scale& scale, double end, double u_end, double inside,
               double u_inside, double low_px, double high_px) {
  if (u_end >= low_px && u_end <= high_px) return end;
  const double target = u_end < low_px ? low_px : high_px;
  double a = end, b = inside, f_a = (u_end - target) * scale(end), f_b = (u_inside - target) * scale(inside);
  for (int iteration = 0; iteration < 12 && f_a != f_b; ++iteration) {
    const double next = a - f_a * (b - a) / (f_b - f_a);
    b = std::exchange(a, next);
    const double beyond = coordinate(a) - target;
    f_b = std::exchange(f_a, beyond * scale(a));
    if (std::abs(beyond) < 1e-3) break;
  }
  return a;
}

// Pixels are squares, and the circle of confusion is a uniform disc, whose variance along an axis is a sixteenth of its squared
// diameter.
Triangulation::PointSpread point_spread_of(const RigModel& rig) {
  const CameraLens& lens = rig.camera_lens;
  // Diameter per difference of the inverse depth from that of the focus.
  const double circle_px_m = states_defocus(lens) ? camera_pupil_m(rig) * rig.camera.fx : 0;
  return {static_cast<float>(1.0 / 12 + lens.blur_px * lens.blur_px),
          static_cast<float>(circle_px_m * circle_px_m / 16), static_cast<float>(1 / lens.focus_m)};
}

// The harmonics that displace the phase, by up to 0.03 rad here, change the modulation by the same share.
bool modulation_shows_texture(const PhaseCorrection& correction) {
  constexpr double kMostRipple = 0.03;
  return std::all_of(correction.offset_rad.begin(), correction.offset_rad.end(),
                     [&](double offset_rad) { return std::abs(offset_rad) <= kMostRipple; });
}

// Interval of inverse depth in which a ray passes through the projector's field.
struct Interval {
  double far, near;
};

// Limits an interval to where a coordinate is between two limits; returns false if that is nowhere.
template <class Coordinate, class Scale>
bool limit(const Coordinate& coordinate, const Scale& scale, double low_px, double high_px, Interval& interval) {
  const double u_far = coordinate(interval.far), u_near = coordinate(interval.near);
  const bool crosses = std::max(u_far, u_near) > low_px && std::min(u_far, u_near) < high_px;
  if (!crosses) return false;
  interval = {clipped(coordinate, scale, interval.far, u_far, interval.near, u_near, low_px, high_px),
              clipped(coordinate, scale, interval.near, u_near, interval.far, u_far, low_px, high_px)};
  return true;
}

// Limits an interval to where the depth in the projector's frame, which is linear in inverse depth, is positive; returns
// false if that is nowhere.
template <class Depth>
bool limit_to_front(const Depth& depth, Interval& interval) {
  constexpr double kLeast = 1e-3;  // relative to the greatest depth
  const double at_far = depth(interval.far), at_near = depth(interval.near), least = kLeast * std::max(at_far, at_near);
  if (!(least > 0)) return false;  // also if it is NaN
  const double per_depth = (interval.near - interval.far) / (at_near - at_far);
  if (at_near < least) interval.near = interval.far + (least - at_far) * per_depth;
  if (at_far < least) interval.far = interval.near + (least - at_near) * per_depth;
  return true;
}

struct Polynomials {
  std::array<Block, kNodes> coefficients;
  Block centre, half_range;
  Block error_px;  // greatest between the nodes and at the ends
};

std::array<double, kNodes> chebyshev_nodes() {
  std::array<double, kNodes> nodes;
  for (int i = 0; i < kNodes; ++i) nodes[static_cast<size_t>(i)] = std::cos(std::numbers::pi * (i + 0.5) / kNodes);
  return nodes;
}

// Newton interpolation with divided differences at Chebyshev nodes of inverse depth, expanded into powers of s.
FRINGESLAM_INLINE void interpolate_body(const Projection& p, const RayBlock& rays, const Block& w_low,
                                        const Block& w_high, const std::array<double, kNodes>& nodes,
                                        Polynomials& result) {
  std::array<Block, kNodes> s, table;
  Block u_low, u_high;
  coordinates_body(p, rays, w_low, u_low);
  coordinates_body(p, rays, w_high, u_high);
#pragma GCC ivdep
  for (size_t i = 0; i < kBlock; ++i) {
    result.centre[i] = 0.5 * (u_low[i] + u_high[i]);
    result.half_range[i] = 0.5 * std::abs(u_high[i] - u_low[i]);
  }
  for (size_t n = 0; n < kNodes; ++n) {
#pragma GCC ivdep
    for (size_t i = 0; i < kBlock; ++i)
      table[n][i] = 0.5 * (w_low[i] + w_high[i]) + 0.5 * (w_high[i] - w_low[i]) * nodes[n];
    coordinates_body(p, rays, table[n], s[n]);
#pragma GCC ivdep
    for (size_t i = 0; i < kBlock; ++i) s[n][i] = (s[n][i] - result.centre[i]) / result.half_range[i];
  }
  for (size_t order = 1; order < kNodes; ++order) {
    for (size_t n = kNodes - 1; n >= order; --n) {
#pragma GCC ivdep
      for (size_t i = 0; i < kBlock; ++i) table[n][i] = (table[n][i] - table[n - 1][i]) / (s[n][i] - s[n - order][i]);
    }
  }
  std::array<Block, kNodes>& c = result.coefficients;
  c = {};
  for (size_t n = kNodes; n-- > 0;) {
    for (size_t k = kDegree; k > 0; --k) {
#pragma GCC ivdep
      for (size_t i = 0; i < kBlock; ++i) c[k][i] = c[k - 1][i] - s[n][i] * c[k][i];
    }
#pragma GCC ivdep
    for (size_t i = 0; i < kBlock; ++i) c[0][i] = table[n][i] - s[n][i] * c[0][i];
  }
  result.error_px.fill(0);
  Block w, u;
  for (size_t n = 0; n <= kNodes; ++n) {
    const double between = n == 0 ? 1 : n == kNodes ? -1 : 0.5 * (nodes[n - 1] + nodes[n]);
#pragma GCC ivdep
    for (size_t i = 0; i < kBlock; ++i) w[i] = 0.5 * (w_low[i] + w_high[i]) + 0.5 * (w_high[i] - w_low[i]) * between;
    coordinates_body(p, rays, w, u);
#pragma GCC ivdep
    for (size_t i = 0; i < kBlock; ++i) {
      const double at = (u[i] - result.centre[i]) / result.half_range[i];
      double value = c[kDegree][i], slope = 0;
      for (size_t k = kDegree; k-- > 0;) {
        slope = slope * at + value;
        value = value * at + c[k][i];
      }
      const double error = std::abs((value - w[i]) * result.half_range[i] / slope);
      result.error_px[i] = error <= result.error_px[i] ? result.error_px[i] : error;  // also if it is NaN
    }
  }
}

struct TriangulationRow {
  std::array<const float*, kNodes> coefficients;
  const float *centre, *per_px;
  Triangulation::PointSpread point_spread;
  float near_m, far_m, max_sigma_m;
};

FRINGESLAM_INLINE void row_body(const TriangulationRow& t, int width, const float* coordinate, const float* sigma_px,
                                const TextureGradient& texture, float* depth, float* sigma) {
  const float *c0 = t.coefficients[0], *c1 = t.coefficients[1], *c2 = t.coefficients[2], *c3 = t.coefficients[3],
              *c4 = t.coefficients[4], *c5 = t.coefficients[5];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float s = (coordinate[i] - t.centre[i]) * t.per_px[i];
    const float w = c0[i] + s * (c1[i] + s * (c2[i] + s * (c3[i] + s * (c4[i] + s * c5[i]))));
    const float slope = c1[i] + s * (2 * c2[i] + s * (3 * c3[i] + s * (4 * c4[i] + s * (5 * c5[i]))));
    const float per_px = slope * t.per_px[i];
    const float variance_px2 = t.point_spread.variance_px2(w);
    const float z = 1 / (w - per_px * variance_px2 * texture.gradient[i]);
    const float noise = std::sqrt(1 + variance_px2 * variance_px2 * texture.noise[i]);
    const float spread = z * z * std::abs(per_px) * sigma_px[i] * noise;
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
    : rays_(rays),
      near_m_(near_m),
      far_m_(far_m),
      pixel_angle_(1 / rig.camera.fx),
      point_spread_(point_spread_of(rig)),
      modulation_shows_texture_(fringeslam::modulation_shows_texture(rig.phase_correction)),
      blur_is_stated_(rig.camera_lens.blur_px > 0) {
  if (!(near_m < far_m))
    throw Error("depth.near_m is " + to_text(near_m) + " but depth.far_m is " + to_text(far_m) +
                "; near_m must be smaller than far_m");
  for (cv::Mat1f& plane : coefficients_) plane = cv::Mat1f(rays.size(), kNaN);
  error_px_ = cv::Mat1f::zeros(rays.size());
  std::atomic<bool> inexact = false;
  centre_ = cv::Mat1f(rays.size(), kNaN);
  per_px_ = cv::Mat1f(rays.size(), kNaN);
  const double low_px = -0.5 - kMarginPx;
  const bool columns = axis == Axis::columns;
  const double high_px = (columns ? rig.projector.width : rig.projector.height) - 0.5 + kMarginPx;
  const double across_high_px = (columns ? rig.projector.height : rig.projector.width) - 0.5 + kMarginPx;
  const double w_far = 0.999 / far_m, w_near = 1.001 / near_m;
  const Projection projection(rig, axis);
  const std::array<double, kNodes> nodes = chebyshev_nodes();
  const InstructionSet set = selected_instruction_set();
  const auto interpolate = Variants<interpolate_body>::of(set);
  for_each_row(rays.rows, [&](int row) {
    RayBlock block{};
    Block low, high;
    std::array<bool, kBlock> crosses;
    Polynomials polynomials;
    for (int first = 0; first < rays.cols; first += kBlock) {
      const int width = std::min(kBlock, rays.cols - first);
      for (int i = 0; i < width; ++i) {
        const cv::Vec2f ray = rays(row, first + i);
        const Eigen::Vector3d direction = rig.projector_from_camera.rotation * Eigen::Vector3d(ray[0], ray[1], 1);
        const auto k = static_cast<size_t>(i);
        block.along[k] = columns ? direction.x() : direction.y();
        block.across[k] = columns ? direction.y() : direction.x();
        block.depth[k] = direction.z();
      }
      low.fill(w_far);
      high.fill(w_near);
      for (int i = 0; i < width; ++i) {
        const auto k = static_cast<size_t>(i);
        const auto along = [&](double inverse_depth) { return lit_at(projection, block, i, inverse_depth).along; };
        const auto across = [&](double inverse_depth) { return lit_at(projection, block, i, inverse_depth).across; };
        Interval lit{w_far, w_near};
        const auto depth = [&](double inverse_depth) { return block.depth[k] + inverse_depth * projection.t_depth_m; };
        const bool in_front = limit_to_front(depth, lit);
        // Close to the projector, a coordinate is a steep hyperbola, which secants may leave; times the depth it is nearly
        // a straight line.
        const auto [nearest, farthest] = std::minmax({depth(lit.far), depth(lit.near)});
        const bool steep = nearest < 0.5 * farthest;
        const auto scale = [&](double inverse_depth) { return steep ? depth(inverse_depth) : 1; };
        crosses[k] =
            in_front && limit(along, scale, low_px, high_px, lit) && limit(across, scale, low_px, across_high_px, lit);
        if (crosses[k]) low[k] = lit.far, high[k] = lit.near;
      }
      interpolate(projection, block, low, high, nodes, polynomials);
      for (int i = 0; i < width; ++i) {
        const auto k = static_cast<size_t>(i);
        const double error_px = polynomials.error_px[k];
        if (!crosses[k] || !(error_px <= kLargestError_px)) continue;
        error_px_(row, first + i) = static_cast<float>(error_px);
        if (error_px > kNegligibleError_px) inexact = true;
        for (size_t n = 0; n < kNodes; ++n)
          coefficients_[n](row, first + i) = static_cast<float>(polynomials.coefficients[n][k]);
        centre_(row, first + i) = static_cast<float>(polynomials.centre[k]);
        per_px_(row, first + i) = static_cast<float>(1 / polynomials.half_range[k]);
      }
    }
  });
  if (!inexact) error_px_.release();
}

void Triangulation::row(int row, const float* coordinate_px, const float* sigma_px, float max_sigma_m, float* depth_m,
                        float* sigma_m, InstructionSet set, const TextureGradient& texture) const {
  TriangulationRow t{
      {},         centre_[row], per_px_[row], point_spread_, static_cast<float>(near_m_), static_cast<float>(far_m_),
      max_sigma_m};
  for (size_t k = 0; k < kNodes; ++k) t.coefficients[k] = coefficients_[k][row];
  const int width = rays_.cols;
  std::vector<float> with_error, none;
  TextureGradient used = texture;
  if (!used.gradient) {
    none.assign(static_cast<size_t>(width), 0.0f);
    used = {none.data(), none.data()};
  }
  if (!error_px_.empty()) {
    with_error.resize(static_cast<size_t>(width));
    for (int col = 0; col < width; ++col)
      with_error[static_cast<size_t>(col)] = std::hypot(sigma_px[col], error_px_(row, col));
    sigma_px = with_error.data();
  }
  Variants<row_body>::of(set)(t, width, coordinate_px, sigma_px, used, depth_m, sigma_m);
}

void points_row(const DepthRows& rows, int width, float per_depth, float* depth, cv::Vec3f* points, float* sigma,
                InstructionSet set) {
  Variants<points_body>::of(set)(rows, width, per_depth, depth, points, sigma);
}

}  // namespace fringeslam
