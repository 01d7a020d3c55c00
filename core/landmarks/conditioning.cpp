// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/conditioning.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/landmarks/morphology.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr double kNear = 0.7, kFar = 1.4;  // m; arbitrary: steps are converted with the same range

// n.p = d with n towards the camera: points in front of the plane have n.p > d.
struct Plane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float offset = 0;
  float height(const cv::Vec3f& p) const { return normal.x() * p[0] + normal.y() * p[1] + normal.z() * p[2] - offset; }
};

// Points at every 16th pixel of every 8th row.
struct Sampled {
  std::vector<float> x, y, z;
  size_t size() const { return x.size(); }
  Eigen::Vector3f point(size_t i) const { return {x[i], y[i], z[i]}; }
};
Sampled sampled_points(const Frame& frame) {
  constexpr int kEvery = 8, kEveryColumn = 16;
  Sampled points;
  for (int r = kEvery / 2; r < frame.height(); r += kEvery) {
    for (int c = kEvery; c < frame.width(); c += kEveryColumn) {
      if (!frame.valid(r, c)) continue;
      const cv::Vec3f& p = frame.points_m(r, c);
      points.x.push_back(p[0]), points.y.push_back(p[1]), points.z.push_back(p[2]);
    }
  }
  return points;
}

// Returns the background plane (ground or wall): among planes through three random points, the one with most inliers,
// provided that at most 2 % of the points lie behind it and more than 4 % on it.
std::optional<Plane> find_background_plane(const Frame& frame, double clearance_m) {
  constexpr int kHypotheses = 200;
  constexpr double kMostBehind = 0.02, kLeastOn = 0.04;
  const Sampled points = sampled_points(frame);
  const size_t count = points.size();
  if (count < 30) return std::nullopt;
  std::mt19937 random(1);
  const auto pick = [&] { return points.point(random() % count); };
  const auto clearance = static_cast<float>(clearance_m);
  const int most_behind = static_cast<int>(kMostBehind * static_cast<double>(count)) + 1;
  std::vector<Plane> planes;
  for (int i = 0; i < kHypotheses; ++i) {
    const Eigen::Vector3f a = pick(), b = pick(), c = pick();
    Eigen::Vector3f normal = (b - a).cross(c - a);
    const float length = normal.norm();
    if (!(length > 1e-4f)) continue;
    normal /= normal.dot(a) > 0 ? -length : length;
    planes.push_back({normal, normal.dot(a)});
  }
  std::vector<int> on(planes.size(), 0), behind(planes.size(), 0);
  for_each_row(static_cast<int>(planes.size()), [&](int i) {
    const Plane plane = planes[static_cast<size_t>(i)];
    int on_it = 0, behind_it = 0;
    for (size_t k = 0; k < count; ++k) {
      const float height = plane.height({points.x[k], points.y[k], points.z[k]});
      on_it += std::abs(height) < 0.5f * clearance;
      behind_it += height < -clearance;
    }
    on[static_cast<size_t>(i)] = on_it;
    behind[static_cast<size_t>(i)] = behind_it;
  });
  std::optional<Plane> best;
  int best_on = static_cast<int>(kLeastOn * static_cast<double>(count));
  for (size_t i = 0; i < planes.size(); ++i) {
    if (behind[i] <= most_behind && on[i] > best_on) best = planes[i], best_on = on[i];
  }
  return best;
}

// Writes 255 for each of `count` points that is nearer than `farthest` and at least `clearance` in front of the plane,
// else 0 (also for NaN).
FRINGESLAM_INLINE void stands_out_body(const cv::Vec3f* points, int count, const Plane& plane, float farthest,
                                       float clearance, uchar* __restrict out) {
  const float x = plane.normal.x(), y = plane.normal.y(), z = plane.normal.z(), offset = plane.offset;
  for (int i = 0; i < count; ++i) {
    const float depth = points[i][2], height = x * points[i][0] + y * points[i][1] + z * depth - offset;
    out[i] = ((depth < farthest) & (height > clearance)) ? 255 : 0;
  }
}

cv::Mat1b foreground_of(const Frame& frame, const ConditioningOptions& options) {
  static const auto stands_out = Variants<stands_out_body>::of(selected_instruction_set());
  constexpr float kEverywhere = std::numeric_limits<float>::infinity();
  const Plane infinitely_far{Eigen::Vector3f::Zero(), -kEverywhere};
  const Plane plane = options.background == Background::plane
                          ? find_background_plane(frame, options.plane_clearance_m).value_or(infinitely_far)
                          : infinitely_far;
  const float farthest =
      options.background == Background::depth ? static_cast<float>(options.background_m) : kEverywhere;
  cv::Mat1b foreground(frame.height(), frame.width());
  for_each_row(frame.height(), [&](int r) {
    stands_out(frame.points_m[r], frame.width(), plane, farthest, static_cast<float>(options.plane_clearance_m),
               foreground[r]);
  });
  return foreground;
}

}  // namespace

cv::Mat1f depth_levels(const Frame& frame, double near_m, double far_m) {
  const auto scale = static_cast<float>(255 / (far_m - near_m)), far = static_cast<float>(far_m);
  cv::Mat1f levels(frame.height(), frame.width());
  for_each_row(frame.height(), [&](int r) {
    const cv::Vec3f* points = frame.points_m[r];
    float* out = levels[r];
    const int width = frame.width();
    for (int c = 0; c < width; ++c) out[c] = scale * (far - points[c][2]);
    // Fill gaps with the lower level of both sides, or with the only one.
    for (int c = 0; c < width; ++c) {
      if (!std::isnan(out[c])) continue;
      int end = c;
      while (end < width && std::isnan(out[end])) ++end;
      const float last = c > 0 ? out[c - 1] : end < width ? out[end] : 0;
      const float next = end < width ? out[end] : last;
      std::fill(out + c, out + end, std::min(last, next));
    }
  });
  return levels;
}

Conditioned condition(const Frame& frame, const ConditioningOptions& options) {
  check_options(options, "conditioning");
  const double levels_per_m = 255 / (kFar - kNear);
  Conditioned result;
  result.foreground = foreground_of(frame, options);
  result.edges = detect_edges(depth_levels(frame, kNear, kFar), options.edges, options.deriche_alpha,
                              options.low_step_m * levels_per_m, options.high_step_m * levels_per_m);
  // Edges within the background, such as those of shadows on the ground, bound no object.
  result.edges &= dilated(BitImage::from(result.foreground));
  Closing closing = close_gaps(result.edges, options.max_dilations);
  result.dilations = closing.dilations;
  result.dilated = std::move(closing.image);
  result.thinned = thinned(result.dilated);
  result.cleaned = remove_open_lines(result.thinned).mask();
  return result;
}

}  // namespace fringeslam
