// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/conditioning.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "core/landmarks/morphology.h"
#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr double kNear = 0.7, kFar = 1.4;  // of the levels; any range does, steps are converted by the same

// n.p = d, n towards the camera: what is nearer to it than the plane has n.p > d.
struct Plane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float offset = 0;
  float height(const cv::Vec3f& p) const { return normal.x() * p[0] + normal.y() * p[1] + normal.z() * p[2] - offset; }
};

// Points of every sixteenth pixel of every eighth row.
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

// Of the planes through three points the one that most points lie on, if hardly any point is behind it and enough are
// on it: the ground, or a wall.
std::optional<Plane> plane_behind(const Frame& frame, double clearance_m) {
  constexpr int kHypotheses = 200;
  constexpr double kMostBehind = 0.02, kLeastOn = 0.04;
  const Sampled points = sampled_points(frame);
  const size_t count = points.size();
  if (count < 30) return std::nullopt;
  std::mt19937 random(1);
  const auto pick = [&] { return points.point(random() % count); };
  const auto clearance = static_cast<float>(clearance_m);
  const int most_behind = static_cast<int>(kMostBehind * static_cast<double>(count)) + 1;
  std::optional<Plane> best;
  int best_on = static_cast<int>(kLeastOn * static_cast<double>(count));
  for (int i = 0; i < kHypotheses; ++i) {
    const Eigen::Vector3f a = pick(), b = pick(), c = pick();
    Eigen::Vector3f normal = (b - a).cross(c - a);
    const float length = normal.norm();
    if (!(length > 1e-4f)) continue;
    normal /= normal.dot(a) > 0 ? -length : length;
    const Plane plane{normal, normal.dot(a)};
    int on = 0, behind = 0;
    for (size_t k = 0; k < count; ++k) {
      const float height = plane.height({points.x[k], points.y[k], points.z[k]});
      on += std::abs(height) < 0.5f * clearance;
      behind += height < -clearance;
    }
    if (behind <= most_behind && on > best_on) best = plane, best_on = on;
  }
  return best;
}

cv::Mat1b foreground_of(const Frame& frame, const ConditioningOptions& options) {
  const auto clearance = static_cast<float>(options.plane_clearance_m);
  const std::optional<Plane> plane =
      options.background == "plane" ? plane_behind(frame, options.plane_clearance_m) : std::nullopt;
  const auto farthest =
      options.background == "depth" ? static_cast<float>(options.background_m) : std::numeric_limits<float>::infinity();
  cv::Mat1b foreground(frame.height(), frame.width());
  for_each_row(frame.height(), [&](int r) {
    for (int c = 0; c < frame.width(); ++c) {
      const cv::Vec3f& p = frame.points_m(r, c);
      const bool stands_out = p[2] < farthest && (!plane || plane->height(p) > clearance);  // false for NaN
      foreground(r, c) = stands_out ? 255 : 0;
    }
  });
  return foreground;
}

}  // namespace

cv::Mat1f depth_levels(const Frame& frame, double near_m, double far_m) {
  const auto scale = static_cast<float>(255 / (far_m - near_m)), far = static_cast<float>(far_m);
  cv::Mat1f levels(frame.height(), frame.width());
  for_each_row(frame.height(), [&](int r) {
    float* out = levels[r];
    const int width = frame.width();
    int filled = 0;  // how many have a level
    float last = std::numeric_limits<float>::quiet_NaN();
    const auto fill_to = [&](int end, float next) {
      // NaN when the row has nothing on one side: the other side then.
      const float value = std::isnan(last) ? next : std::isnan(next) ? last : std::min(last, next);
      for (; filled < end; ++filled) out[filled] = std::isnan(value) ? 0 : value;
    };
    for (int c = 0; c < width; ++c) {
      const float z = frame.points_m(r, c)[2];
      if (std::isnan(z)) continue;
      const float level = scale * (far - z);
      fill_to(c, level);
      out[filled++] = last = level;
    }
    fill_to(width, std::numeric_limits<float>::quiet_NaN());
  });
  return levels;
}

Conditioned condition(const Frame& frame, const ConditioningOptions& options) {
  check_options(options, "conditioning");
  const double levels_per_m = 255 / (kFar - kNear);
  Conditioned result;
  result.foreground = foreground_of(frame, options);
  BitImage edges = BitImage::from(detect_edges(depth_levels(frame, kNear, kFar), options.edges, options.deriche_alpha,
                                               options.low_step_m * levels_per_m, options.high_step_m * levels_per_m));
  // Edges of background alone, such as those of shadows on the ground, bound nothing.
  edges &= dilated(BitImage::from(result.foreground));
  const Closing closing = dilated_until_closed(edges, options.max_dilations);
  const BitImage thin = thinned(closing.image);
  result.edges = edges.mask();
  result.dilations = closing.dilations;
  result.dilated = closing.image.mask();
  result.thinned = thin.mask();
  result.cleaned = without_loose_ends(thin).mask();
  return result;
}

}  // namespace fringeslam
