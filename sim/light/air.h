// SPDX-License-Identifier: Apache-2.0
// Single scattering in homogeneous air: phase function and sampling along a ray (docs/method.md, section 12.3).
#pragma once

#include <Eigen/Core>

namespace fringeslam::sim {

// Length, m, up to which rays without a surface hit are integrated through the haze.
inline constexpr double kSkyDistance = 20;

// Returns the Henyey-Greenstein phase function (1941), 1/sr, for the cosine of the scattering angle; 1 is forward.
double henyey_greenstein(double anisotropy, double cosine);

// Point sampled along a ray, with its probability density.
struct AirSample {
  double distance_m = 0;     // from the ray's origin
  double density_per_m = 1;  // probability density of the sample
};
// Samples a point of a ray uniformly in the angle subtended at the light (Kulla and Fajardo 2012). This cancels the
// inverse-square falloff and so keeps the variance low; `u` is uniform in (0, 1), directions have unit length.
AirSample equiangular(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double length_m,
                      const Eigen::Vector3d& light, double u);

}  // namespace fringeslam::sim
