// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/reference/hull.h"

#include <cmath>

namespace fringeslam {

namespace {

// Twice the signed area of the triangle; values at rounding level count as 0.
double turn(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d u = b - a, v = c - a;
  const double area = u.x() * v.y() - u.y() * v.x();
  return std::abs(area) <= 1e-12 * (u.norm() * v.norm()) ? 0 : area;
}

}  // namespace

ConvexHull gift_wrap(const std::vector<Eigen::Vector2d>& points) {
  const int count = static_cast<int>(points.size());
  const auto at = [&](int i) -> const Eigen::Vector2d& { return points[static_cast<size_t>(i)]; };
  ConvexHull hull;
  if (count == 0) return hull;
  int leftmost = 0;
  for (int i = 0; i < count; ++i) {
    if (!at(i).allFinite()) return {HullStatus::undefined, {}};
    if (at(i).x() < at(leftmost).x() || (at(i).x() == at(leftmost).x() && at(i).y() < at(leftmost).y())) leftmost = i;
  }
  int corner = leftmost;
  do {
    hull.corners.push_back(corner);
    int next = -1;
    for (int i = 0; i < count; ++i) {
      if (at(i) == at(corner)) continue;
      if (next < 0) {
        next = i;
        continue;
      }
      const double side = turn(at(corner), at(next), at(i));
      const bool farther = (at(i) - at(corner)).squaredNorm() > (at(next) - at(corner)).squaredNorm();
      if (side < 0 || (side == 0 && farther)) next = i;
    }
    if (next < 0) return {HullStatus::point, {leftmost}};
    corner = next;
  } while (at(corner) != at(leftmost) && static_cast<int>(hull.corners.size()) < count);
  hull.status = hull.corners.size() < 3 ? HullStatus::segment : HullStatus::polygon;
  return hull;
}

}  // namespace fringeslam
