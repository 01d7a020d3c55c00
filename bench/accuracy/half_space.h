// SPDX-License-Identifier: Apache-2.0
// Exact radiative transfer in a half-space that scatters isotropically and has no refracting boundary: the prediction
// for fringes on translucent surfaces. It shares neither model nor code with the simulator.
//
// Light with the pattern e^(i k x) on the surface reaches the optical depth t below x with the factor e^(-p t), and
// light scattered there leaves at x towards the viewer with the factor e^(-q t),
//
//   p = (1 - i k.l_t) / l_n,   q = (1 + i k.v_t) / v_n,
//
// where l and v are the unit vectors to light and viewer, normal and tangential components, lengths in mean free paths.
// The Wiener-Hopf solution of the transport equation, Fourier transformed along the surface, gives the light sent back
//
//   pi f_r = w / 4  H(1/p) H(1/q) / ((p + q) l_n v_n),
//   ln H(z) = -(z / pi) int_0^inf ln(1 - w atan(s) / s) / (1 + z^2 t^2) dt,   s^2 = t^2 + |k|^2,
//
// with the single-scattering albedo w. For k = 0, H is that of Chandrasekhar (1960).
#pragma once

#include <Eigen/Core>
#include <complex>

namespace fringeslam::bench {

class HalfSpace {
 public:
  // `scattering`: single-scattering albedo, 0 to 1.
  explicit HalfSpace(double scattering) : scattering_(scattering) {}
  // Returns the half-space with this diffuse albedo, 0 to 0.99, under perpendicular light.
  static HalfSpace of_albedo(double albedo);

  // Returns H for a wave number in radians per mean free path.
  std::complex<double> h(std::complex<double> z, double wave_number) const;
  // Returns the diffuse albedo under light at this cosine to the normal, 1 - H sqrt(1 - w).
  double albedo(double cosine) const;
  // Returns pi f_r: modulus and phase of the pattern seen. `wave`: vector along the surface, whose normal is z.
  std::complex<double> reflected(const Eigen::Vector3d& to_light, const Eigen::Vector3d& to_viewer,
                                 const Eigen::Vector2d& wave) const;

 private:
  double scattering_;
};

}  // namespace fringeslam::bench
