// SPDX-License-Identifier: Apache-2.0
// Reflection of a surface point: a Lambertian lobe under a coat, and the coat's or the metal's GGX lobe (Walter et al.
// 2007, with Smith's height-correlated masking and Schlick's Fresnel term).
//
//   pi f_r = rho (1 - F(n.l)) (1 - F(n.v)) + pi D(h) G(l, v) F(v.h) / (4 n.l n.v)
//
// pi f_r is what multiplies illuminance to give W = pi L (sim/light/photometry.h): the albedo, for a matt surface.
#pragma once

#include <Eigen/Core>

namespace fringeslam::sim {

// A surface point's reflection.
struct Reflection {
  double albedo = 0;       // rho, of the Lambertian lobe
  double reflectance = 0;  // F at normal incidence; 0: no glossy lobe
  double alpha = 0.2;      // roughness squared
};

// pi f_r; directions are unit and point away from the surface. 0 when one of them is below it.
double reflected(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_light,
                 const Eigen::Vector3d& to_viewer);

// A direction from which light comes to the viewer, drawn by two uniform numbers and one that chooses the lobe; weight
// is f_r cos / density, by which that light counts. Weight 0: no light from there.
struct ScatteredRay {
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  double weight = 0;
  bool glossy = false;  // drawn from the glossy lobe
};
ScatteredRay scatter(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_viewer,
                     double choice, double u1, double u2);

}  // namespace fringeslam::sim
