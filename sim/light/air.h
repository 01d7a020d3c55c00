// SPDX-License-Identifier: Apache-2.0
// Single scattering in homogeneous air: phase function, and where along a ray to look for it.
#pragma once

#include <Eigen/Core>

namespace fringeslam::sim {

// Rays that meet no surface are followed through the haze this far, m.
inline constexpr double kSkyDistance = 20;

// Density over the sphere of the scattered direction, 1/sr; cosine 1 is straight on (Henyey and Greenstein 1941).
double henyey_greenstein(double anisotropy, double cosine);

// A point of a ray, drawn evenly in the angle under which it is seen from a light (Kulla and Fajardo 2012): as its
// light falls with the square of the distance, the estimate hardly varies.
struct AirSample {
  double distance_m = 0;     // from the ray's origin
  double density_per_m = 1;  // of the draw
};
AirSample equiangular(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double length_m,
                      const Eigen::Vector3d& light, double u);

}  // namespace fringeslam::sim
