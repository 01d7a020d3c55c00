// SPDX-License-Identifier: Apache-2.0
// Enclosing convex polytopes (solid_parts.h): a quickhull that always adds the point requiring the largest scaling of
// the hull, so that it can stop at any number of corners.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "sim/scene/solid_parts.h"

namespace fringeslam::sim {

namespace {

struct Facet {
  std::array<size_t, 3> corners;  // counter-clockwise seen from outside
  Eigen::Vector3d normal;         // unit, outwards
  double offset;                  // normal . x on the facet
  size_t farthest;                // index of the point farthest above the facet
  double distance;                // of that point from the facet, m
  double depth;                   // of a fixed interior point below the facet, m
};

class GrowingHull {
 public:
  explicit GrowingHull(const Points3d& points) : points_(points) {
    for (const auto& p : points) middle_ += p / static_cast<double>(points.size());
    for (const auto& p : points) reach_ = std::max(reach_, (p - middle_).norm());
    start();
  }

  void grow(size_t max_corners) {
    while (corners_.size() < max_corners) {
      const auto worst = std::max_element(facets_.begin(), facets_.end(), [](const Facet& a, const Facet& b) {
        return a.distance * b.depth < b.distance * a.depth;
      });
      if (worst->distance <= tolerance()) return;
      add(worst->farthest);
    }
  }

  Points3d enlarged_corners() const {
    double scale = 1;
    for (const Facet& f : facets_) scale = std::max(scale, 1 + f.distance / f.depth);
    Points3d result;
    for (const size_t i : corners_) result.push_back(inside_ + scale * (points_[i] - inside_));
    return result;
  }

 private:
  double tolerance() const { return 1e-9 * reach_; }

  // Returns the point that maximises a convex measure, which is a corner of the convex hull. The squared distance from
  // the centre breaks ties between coplanar points, so that no point between corners is chosen.
  template <typename Measure>
  size_t extreme(const Measure& measure) const {
    size_t best = 0;
    double most = -std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < points_.size(); ++i) {
      const double value = measure(points_[i]) + 1e-7 * (points_[i] - middle_).squaredNorm() / reach_;
      if (value > most) most = value, best = i;
    }
    return best;
  }

  Facet facet(size_t a, size_t b, size_t c) const {
    Facet f{{a, b, c}, (points_[b] - points_[a]).cross(points_[c] - points_[a]).normalized(), 0, 0, 0, 0};
    f.offset = f.normal.dot(points_[a]);
    f.farthest = extreme([&](const Eigen::Vector3d& p) { return f.normal.dot(p); });
    f.distance = f.normal.dot(points_[f.farthest]) - f.offset;
    f.depth = f.offset - f.normal.dot(inside_);
    return f;
  }

  void start() {
    const size_t a = extreme([](const Eigen::Vector3d& p) { return p.x(); });
    size_t b = extreme([&](const Eigen::Vector3d& p) { return (p - points_[a]).norm(); });
    const Eigen::Vector3d along = (points_[b] - points_[a]).normalized();
    size_t c = extreme([&](const Eigen::Vector3d& p) { return (p - points_[a]).cross(along).norm(); });
    const Eigen::Vector3d normal = along.cross(points_[c] - points_[a]).normalized();
    const double offset = normal.dot(points_[a]);
    const size_t d = extreme([&](const Eigen::Vector3d& p) { return std::abs(normal.dot(p) - offset); });
    if (normal.dot(points_[d]) > offset) std::swap(b, c);
    corners_ = {a, b, c, d};
    inside_ = (points_[a] + points_[b] + points_[c] + points_[d]) / 4;
    facets_ = {facet(a, b, c), facet(a, d, b), facet(b, d, c), facet(c, d, a)};
  }

  void add(size_t corner) {
    std::set<std::pair<size_t, size_t>> edges;  // of the facets visible from the new corner
    std::erase_if(facets_, [&](const Facet& f) {
      if (f.normal.dot(points_[corner]) - f.offset <= tolerance()) return false;
      for (size_t i = 0; i < 3; ++i) edges.emplace(f.corners[i], f.corners[(i + 1) % 3]);
      return true;
    });
    for (const auto& [from, to] : edges) {
      if (!edges.contains({to, from})) facets_.push_back(facet(from, to, corner));
    }
    corners_.push_back(corner);
  }

  const Points3d& points_;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();
  double reach_ = 0;
  Eigen::Vector3d inside_ = Eigen::Vector3d::Zero();
  std::vector<size_t> corners_;
  std::vector<Facet> facets_;
};

}  // namespace

Points3d convex_cover(const Points3d& points, size_t max_corners) {
  GrowingHull hull(points);
  hull.grow(max_corners);
  return hull.enlarged_corners();
}

Points3d prism_cover(const Points3d& points, const Eigen::Vector3d& axis, int sides) {
  const Eigen::Vector3d z = axis.normalized(), x = z.unitOrthogonal(), y = z.cross(x);
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  const auto local = [&](const Eigen::Vector3d& p) { return Eigen::Vector3d(x.dot(p), y.dot(p), z.dot(p)); };
  for (const auto& p : points) low = low.cwiseMin(local(p)), high = high.cwiseMax(local(p));
  const Eigen::Vector3d middle = (low + high) / 2;
  double radius = 0;
  for (const auto& p : points) radius = std::max(radius, (local(p) - middle).head<2>().norm());
  radius /= std::cos(std::numbers::pi / sides);  // circumscribed
  Points3d corners;
  for (int i = 0; i < 2 * sides; ++i) {
    const double angle = 2 * std::numbers::pi * (i / 2) / sides;
    corners.push_back((middle.x() + radius * std::cos(angle)) * x + (middle.y() + radius * std::sin(angle)) * y +
                      (i % 2 == 0 ? low : high).z() * z);
  }
  return corners;
}

}  // namespace fringeslam::sim
