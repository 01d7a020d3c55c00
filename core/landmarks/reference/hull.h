// SPDX-License-Identifier: Apache-2.0
// Convex hull by gift wrapping (METHOD S15; thesis 3.2.2, Fig. 3-11): O(n h).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam {

enum class HullStatus {
  polygon,   // three corners or more
  segment,   // all points on a line: its two ends
  point,     // all points alike: that one
  empty,     // no points
  undefined  // a coordinate is not finite
};

struct ConvexHull {
  HullStatus status = HullStatus::empty;
  std::vector<int> corners;  // indices; of a polygon from the leftmost, turning from +x towards +y. No collinear middle
                             // points, no point twice.
};

ConvexHull gift_wrap(const std::vector<Eigen::Vector2d>& points);

}  // namespace fringeslam
