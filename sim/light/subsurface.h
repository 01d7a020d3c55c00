// SPDX-License-Identifier: Apache-2.0
// Light that enters a translucent surface at one point and leaves it at another (docs/method.md, section 12.1). With the
// diffuse albedo A and the transport mean free path l = 1 / (sigma_s' + sigma_a), the light entering at a distance r
// from the point seen has the density of Christensen and Burley (2015),
//
//   R(r) / A = (e^(-r/d) + e^(-r/(3d))) / (8 pi d r),   d = l / (1.85 - A + 7 |A - 0.8|^3),             (1)
//
// a quarter of it in the near term and three quarters in the far term. Light travels on before it scatters, and a
// viewer looks below the surface, so that the point of entry of the far term is displaced by
//
//   c l (t_l - t_v) / n,   c = 0.7 (1 + A),                                                            (2)
//
// with the components t_l, t_v along the surface of the unit vectors to light and viewer, and the refractive index n.
// On a white surface, the mean over both terms is nearly one mean free path along the refracted ray (Wang and Jacques
// 1995); c is fitted to the exact solution for isotropic scattering (docs/method.md).
#pragma once

namespace fringeslam::sim {

// Returns d of eq. 1, m.
double profile_length_m(double albedo, double mean_free_path_m);

// Returns c l of eq. 2, m.
double far_shift_m(double albedo, double mean_free_path_m);

// Returns the refractive index of a dielectric with this reflectance at normal incidence; 1 for a reflectance of 0.
double refractive_index(double reflectance);

struct ProfileSample {
  double radius_m = 0;
  bool far = false;  // drawn from the far term
};
// Draws a radius with the density 2 pi r R(r) / A; `u` is uniform in [0, 1).
ProfileSample sample_profile(double length_m, double u);

}  // namespace fringeslam::sim
