// SPDX-License-Identifier: Apache-2.0
// Surface reflection model: a Lambertian base under a dielectric coat, plus the GGX lobe of the coat or metal (Walter
// et al. 2007, with Smith's height-correlated masking and Schlick's Fresnel approximation).
//
//   pi f_r = rho (1 - F(n.l)) (1 - F(n.v)) + pi D(h) G(l, v) F(v.h) / (4 n.l n.v)
//
// pi f_r is the factor from illuminance to W = pi L (sim/light/photometry.h); for a diffuse surface it is the albedo.
#pragma once

#include <Eigen/Core>

namespace fringeslam::sim {

// Reflection parameters of a surface point.
struct Reflection {
  double albedo = 0;       // rho, albedo of the Lambertian lobe
  double reflectance = 0;  // F at normal incidence; 0: no glossy lobe
  double alpha = 0.2;      // roughness squared
};

// Returns a right-handed orthonormal frame with n as its z axis.
Eigen::Matrix3d frame_about(const Eigen::Vector3d& n);

// Returns the fraction of the light that passes a coat of this reflectance at normal incidence, by the cosine of the
// angle of incidence.
double passed(double reflectance, double cosine);

// Reflectance of water at normal incidence (refractive index 1.333).
constexpr double kWaterReflectance = 0.0204;

// Returns the albedo rho of the Lambertian lobe below a film of water on a surface of this albedo, which contains the light
// that the film's surface reflects back to it (docs/method.md, section 12.1).
double wet_albedo(double dry_albedo);

// Returns pi f_r for unit directions that point away from the surface; 0 if either is below the surface.
double reflected(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_light,
                 const Eigen::Vector3d& to_viewer);

// Sampled direction of incoming light, away from the surface; weight = f_r cos / density, 0 for an invalid sample.
struct BrdfSample {
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  double weight = 0;
  bool glossy = false;  // sampled from the glossy lobe
};
// Importance-samples a direction of incoming light: `choice` selects the lobe, u1 and u2 the direction; all are uniform
// in (0, 1).
BrdfSample scatter(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_viewer,
                   double choice, double u1, double u2);

}  // namespace fringeslam::sim
