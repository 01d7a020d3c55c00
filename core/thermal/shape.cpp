// SPDX-License-Identifier: Apache-2.0
#include "core/thermal/shape.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <utility>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Patch = std::vector<SurfacePoint>;

struct OnPlane {
  double cosine, distance_m;
  bool operator()(const SurfacePoint& plane, const SurfacePoint& p) const {
    return plane.normal.dot(p.normal) > cosine && std::abs(plane.normal.dot(p.point_m - plane.point_m)) < distance_m;
  }
};

// Returns the point whose plane holds most of the others; at most about 150 points are tried.
const SurfacePoint& best_plane(const Patch& patch, const OnPlane& on_plane) {
  constexpr size_t kTried = 150;
  const size_t step = std::max<size_t>(1, patch.size() / kTried);
  size_t best = 0;
  std::ptrdiff_t most = 0;
  for (size_t i = 0; i < patch.size(); i += step) {
    const auto held =
        std::count_if(patch.begin(), patch.end(), [&](const SurfacePoint& p) { return on_plane(patch[i], p); });
    if (held > most) most = held, best = i;
  }
  return patch[best];
}

struct Cylinder {
  Eigen::Vector3d centre, axis;
  double radius;
  double along(const Eigen::Vector3d& p) const { return axis.dot(p - centre); }
  Eigen::Vector3d across(const Eigen::Vector3d& p) const { return p - centre - along(p) * axis; }
};

// Two directions that span the plane perpendicular to `axis`.
std::pair<Eigen::Vector3d, Eigen::Vector3d> frame_across(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d u = axis.unitOrthogonal();
  return {u, axis.cross(u)};
}

// Initial cylinder: radius and centre by linear least squares of |q|^2 + a.q + b = 0 across the axis (Kasa 1976).
std::optional<Cylinder> initial_cylinder(const Patch& patch) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
  for (const SurfacePoint& p : patch) {
    mean += p.point_m / static_cast<double>(patch.size());
    normals += p.normal * p.normal.transpose();
  }
  const Eigen::Vector3d axis = symmetric_eigen(normals).vectors.col(0);
  const auto [u, v] = frame_across(axis);
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const SurfacePoint& p : patch) {
    const Eigen::Vector3d q(u.dot(p.point_m - mean), v.dot(p.point_m - mean), 1);
    information += q * q.transpose();
    right -= (q.x() * q.x() + q.y() * q.y()) * q;
  }
  const Eigen::Vector3d solution = solve_symmetric(information, right);
  const Eigen::Vector2d middle = -0.5 * solution.head<2>();
  const double squared = middle.squaredNorm() - solution.z();
  if (!(squared > 0) || !solution.allFinite()) return std::nullopt;
  return Cylinder{mean + middle.x() * u + middle.y() * v, axis, std::sqrt(squared)};
}

// One Gauss-Newton step on the distances |across| - radius, in centre, axis and radius.
void refine(Cylinder& cylinder, const Patch& patch) {
  const auto [u, v] = frame_across(cylinder.axis);
  Matrix5d information = Matrix5d::Zero();
  Vector5d right = Vector5d::Zero();
  for (const SurfacePoint& p : patch) {
    const Eigen::Vector3d across = cylinder.across(p.point_m);
    const double distance = across.norm(), along = cylinder.along(p.point_m);
    if (!(distance > 0)) continue;
    const Eigen::Vector3d outward = across / distance;
    Vector5d g;
    g << -outward.dot(u), -outward.dot(v), -along * outward.dot(u), -along * outward.dot(v), -1;
    information += g * g.transpose();
    right -= (distance - cylinder.radius) * g;
  }
  information.diagonal() += Vector5d::Constant(1e-9 * information.trace());
  const Vector5d step = solve_symmetric(information, right);
  if (!step.allFinite()) return;
  cylinder.centre += step[0] * u + step[1] * v;
  cylinder.axis = (cylinder.axis + step[2] * u + step[3] * v).normalized();
  cylinder.radius += step[4];
}

bool holds(const Cylinder& cylinder, const SurfacePoint& p, const ThermalOptions& options) {
  constexpr double kLeastCosine = 0.94;  // 20 degrees between point normal and cylinder normal
  const Eigen::Vector3d across = cylinder.across(p.point_m);
  const double distance = across.norm();
  return std::abs(distance - cylinder.radius) < options.pipe_distance_m &&
         across.dot(p.normal) > kLeastCosine * distance;
}

// Returns the cylinder through two points with these normals, if it is thin enough.
std::optional<Cylinder> cylinder_through(const SurfacePoint& a, const SurfacePoint& b, double max_radius_m) {
  constexpr double kLeastTurn = 0.2;  // rad, below which the axis is unreliable
  const Eigen::Vector3d axis = a.normal.cross(b.normal);
  if (axis.norm() < kLeastTurn) return std::nullopt;
  Cylinder cylinder{a.point_m, axis.normalized(), 0};
  // Both normals extend back to the axis: across it, a - r n_a = b - r n_b.
  const Eigen::Vector3d apart = cylinder.across(b.point_m), turned = b.normal - a.normal;
  cylinder.radius = apart.dot(turned) / turned.squaredNorm();
  cylinder.centre = a.point_m - cylinder.radius * a.normal;
  if (!(cylinder.radius > 0) || cylinder.radius > max_radius_m) return std::nullopt;
  return cylinder;
}

// Range between the 2nd and the 98th percentile.
double extent(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t cut = values.size() / 50;
  return values[values.size() - 1 - cut] - values[cut];
}

}  // namespace

double planar_share(const Patch& patch, const ThermalOptions& options) {
  if (patch.empty()) return 0;
  const OnPlane on_plane{std::cos(options.plane_angle_deg * std::numbers::pi / 180), options.plane_distance_m};
  Patch left = patch;
  for (int plane = 0; plane < 2 && !left.empty(); ++plane) {
    const SurfacePoint best = best_plane(left, on_plane);
    std::erase_if(left, [&](const SurfacePoint& p) { return on_plane(best, p); });
  }
  return 1 - static_cast<double>(left.size()) / static_cast<double>(patch.size());
}

PipeFit fit_pipe(const Patch& patch, const ThermalOptions& options) {
  constexpr size_t kLeast = 20;
  constexpr int kRounds = 8;
  PipeFit fit;
  if (patch.size() < kLeast) return fit;
  std::optional<Cylinder> cylinder = initial_cylinder(patch);
  if (!cylinder) return fit;
  // Points far off belong to something else, e.g. a joint: they are excluded from the second half of the rounds on.
  Patch near = patch;
  for (int round = 0; round < kRounds; ++round) {
    refine(*cylinder, near);
    if (round < kRounds / 2 - 1) continue;
    const auto off = [&](const SurfacePoint& p) {
      return std::abs(cylinder->across(p.point_m).norm() - cylinder->radius);
    };
    near = patch;
    std::erase_if(near, [&](const SurfacePoint& p) { return off(p) > 2 * options.pipe_distance_m; });
    if (near.size() < patch.size() / 2) near = patch;
  }
  if (!(cylinder->radius > 0) || !cylinder->centre.allFinite()) return fit;
  std::vector<double> along, sideways;
  size_t on = 0;
  // The width is measured as seen, perpendicular to the mean normal.
  Eigen::Vector3d towards = Eigen::Vector3d::Zero();
  for (const SurfacePoint& p : patch) towards += p.normal;
  const Eigen::Vector3d side = cylinder->axis.cross(towards).normalized();
  for (const SurfacePoint& p : patch) {
    along.push_back(cylinder->along(p.point_m));
    sideways.push_back(side.dot(p.point_m));
    on += std::abs(cylinder->across(p.point_m).norm() - cylinder->radius) < options.pipe_distance_m;
  }
  fit.found = true;
  fit.share = static_cast<double>(on) / static_cast<double>(patch.size());
  fit.radius_m = cylinder->radius;
  fit.length_m = extent(std::move(along));
  fit.width_m = extent(std::move(sideways));
  return fit;
}

std::vector<char> find_long_pipe(const Patch& patch, double least_share, const ThermalOptions& options) {
  constexpr size_t kTried = 400, kLooked = 200, kLeast = 60;
  constexpr double kLeastLength = 3;  // relative to its diameter
  if (patch.size() < kLeast) return {};
  // Deterministic pairs spread over the patch; a subset of the points suffices to count a cylinder's inliers.
  const size_t step = std::max<size_t>(1, patch.size() / kLooked);
  std::optional<Cylinder> best;
  size_t most = 0;
  for (size_t k = 0; k < kTried; ++k) {
    const SurfacePoint& a = patch[k * 7919 % patch.size()];
    const SurfacePoint& b = patch[(k * 104729 + 53) % patch.size()];
    const std::optional<Cylinder> tried = cylinder_through(a, b, options.max_pipe_radius_m);
    if (!tried) continue;
    size_t held = 0;
    for (size_t i = 0; i < patch.size(); i += step) held += holds(*tried, patch[i], options);
    if (held > most) most = held, best = tried;
  }
  if (!best) return {};
  for (int round = 0; round < 3; ++round) {
    Patch on;
    std::copy_if(patch.begin(), patch.end(), std::back_inserter(on),
                 [&](const SurfacePoint& p) { return holds(*best, p, options); });
    if (on.size() < kLeast / 2) return {};
    refine(*best, on);
  }
  std::vector<char> result;
  std::vector<double> along;
  for (const SurfacePoint& p : patch) {
    result.push_back(holds(*best, p, options));
    if (result.back()) along.push_back(best->along(p.point_m));
  }
  const bool much = static_cast<double>(along.size()) >= least_share * static_cast<double>(patch.size());
  const bool thin = best->radius > 0 && best->radius < options.max_pipe_radius_m;
  if (along.empty() || !much || !thin || extent(along) < kLeastLength * 2 * best->radius) return {};
  return result;
}

}  // namespace fringeslam
