// SPDX-License-Identifier: Apache-2.0
// Convex hull by gift wrapping (docs/method.md, section 5.3; thesis 3.2.2, Fig. 3-11), O(n h).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam {

enum class HullStatus {
  polygon,   // three or more corners
  segment,   // all points collinear: the two ends
  point,     // all points equal: one of them
  empty,     // no points
  undefined  // some coordinate is not finite
};

struct ConvexHull {
  HullStatus status = HullStatus::empty;
  std::vector<int> corners;  // indices; of a polygon from the leftmost point, turning from +x towards +y. No collinear
                             // intermediate points, no duplicates.
};

// Returns the convex hull of the points, as indices of its corners.
ConvexHull gift_wrap(const std::vector<Eigen::Vector2d>& points);

}  // namespace fringeslam
