// SPDX-License-Identifier: Apache-2.0
// Shape tests of surface patches from points and normals: planes and pipes.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/thermal/options.h"

namespace fringeslam {

struct SurfacePoint {
  Eigen::Vector3d point_m, normal;  // unit normal
};

// Returns the share of the points on the two planes that hold most of them: the best plane through a point with its
// normal, then the best one of the remaining points. 0 without points.
double planar_share(const std::vector<SurfacePoint>& patch, const ThermalOptions& options);

struct PipeFit {
  bool found = false;  // true if a cylinder could be fitted
  double share = 0;    // of the points within pipe_distance_m
  double radius_m = 0;
  double length_m = 0;  // of the visible part, along the axis
  double width_m = 0;   // of the visible part, across the axis
};

// Fits a cylinder by least squares; the initial axis is the direction most perpendicular to the normals.
PipeFit fit_pipe(const std::vector<SurfacePoint>& patch, const ThermalOptions& options);

// Marks the points on the best-supported pipe in the patch, if it holds at least `least_share` of them and is at least
// three times as long as its diameter; else the result is empty.
std::vector<char> find_long_pipe(const std::vector<SurfacePoint>& patch, double least_share,
                                 const ThermalOptions& options);

}  // namespace fringeslam
