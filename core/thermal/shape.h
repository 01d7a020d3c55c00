// SPDX-License-Identifier: Apache-2.0
// Is a patch of surface flat, or part of a pipe? By its points and their normals.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/thermal/options.h"

namespace fringeslam {

struct SurfacePoint {
  Eigen::Vector3d point_m, normal;  // unit
};

// Share of the points on the two planes that hold most of them: one through a point with its normal, and one more of
// those that are left. 0 for no points.
double planar_share(const std::vector<SurfacePoint>& patch, const ThermalOptions& options);

struct PipeFit {
  bool found = false;  // whether a cylinder fits at all
  double share = 0;    // of the points within pipe_distance_m
  double radius_m = 0;
  double length_m = 0;  // of what is seen, along the axis
  double width_m = 0;   // across axis
};

// The cylinder of least squares, its axis started from the normals, which are all across it.
PipeFit fit_pipe(const std::vector<SurfacePoint>& patch, const ThermalOptions& options);

// Of a patch of which a pipe may be part: which of its points lie on the longest one that holds at least `least_share`
// of them, and is at least three times as long as wide. Empty when there is none.
std::vector<char> on_long_pipe(const std::vector<SurfacePoint>& patch, double least_share,
                               const ThermalOptions& options);

}  // namespace fringeslam
