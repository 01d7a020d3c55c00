// SPDX-License-Identifier: Apache-2.0
#include "sim/light/gloss.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"

namespace fringeslam::sim {

namespace {

double fresnel(double reflectance, double cosine) {
  const double x = std::clamp(1 - cosine, 0.0, 1.0);
  return reflectance + (1 - reflectance) * x * x * x * x * x;
}

// Smith's Lambda; 1 / (1 + Lambda) is the unmasked fraction of the microfacets seen from a direction.
double lambda(double alpha, double cosine) {
  const double tangent2 = std::max(0.0, 1 / (cosine * cosine) - 1);
  return 0.5 * (std::sqrt(1 + alpha * alpha * tangent2) - 1);
}

double distribution(double alpha, double cosine) {
  const double a2 = alpha * alpha, d = cosine * cosine * (a2 - 1) + 1;
  return a2 / (kPi * d * d);
}

// Samples a microfacet normal from the distribution of visible normals (Heitz 2018); local frame.
Eigen::Vector3d sample_visible_normal(const Eigen::Vector3d& view, double alpha, double u1, double u2) {
  const Eigen::Vector3d stretched = Eigen::Vector3d(alpha * view.x(), alpha * view.y(), view.z()).normalized();
  const double side = stretched.head<2>().squaredNorm();
  const Eigen::Vector3d t1 = side > 0
                                 ? Eigen::Vector3d(Eigen::Vector3d(-stretched.y(), stretched.x(), 0) / std::sqrt(side))
                                 : Eigen::Vector3d::UnitX();
  const Eigen::Vector3d t2 = stretched.cross(t1);
  const double r = std::sqrt(u1), phi = 2 * kPi * u2, half = 0.5 * (1 + stretched.z());
  const double p1 = r * std::cos(phi);
  const double p2 = (1 - half) * std::sqrt(std::max(0.0, 1 - p1 * p1)) + half * r * std::sin(phi);
  const Eigen::Vector3d h = p1 * t1 + p2 * t2 + std::sqrt(std::max(0.0, 1 - p1 * p1 - p2 * p2)) * stretched;
  return Eigen::Vector3d(alpha * h.x(), alpha * h.y(), std::max(1e-9, h.z())).normalized();
}

}  // namespace

Eigen::Matrix3d frame_about(const Eigen::Vector3d& n) {
  const Eigen::Vector3d helper = std::abs(n.x()) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  Eigen::Matrix3d frame;
  frame.col(0) = n.cross(helper).normalized();
  frame.col(1) = n.cross(frame.col(0));
  frame.col(2) = n;
  return frame;
}

double passed(double reflectance, double cosine) { return reflectance == 0 ? 1 : 1 - fresnel(reflectance, cosine); }

double wet_albedo(double dry_albedo) {
  constexpr double kIndex = 1.333;
  // Share of Lambertian light from outside that the interface reflects; the integral of Schlick's (1 - cos)^5 2 cos is 1/21.
  constexpr double kFromOutside = kWaterReflectance + (1 - kWaterReflectance) / 21;
  // By reciprocity, n^2 (1 - R_inside) = 1 - R_outside.
  constexpr double kFromInside = 1 - (1 - kFromOutside) / (kIndex * kIndex);
  return dry_albedo / (kIndex * kIndex * (1 - kFromInside * dry_albedo));
}

double reflected(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_light,
                 const Eigen::Vector3d& to_viewer) {
  const double nl = normal.dot(to_light), nv = normal.dot(to_viewer);
  if (nl <= 0 || nv <= 0) return 0;
  if (surface.reflectance == 0) return surface.albedo;
  const Eigen::Vector3d half = (to_light + to_viewer).normalized();
  const double matt = surface.albedo * (1 - fresnel(surface.reflectance, nl)) * (1 - fresnel(surface.reflectance, nv));
  const double masking = 1 / (1 + lambda(surface.alpha, nl) + lambda(surface.alpha, nv));
  const double gloss = kPi * distribution(surface.alpha, normal.dot(half)) * masking *
                       fresnel(surface.reflectance, to_viewer.dot(half)) / (4 * nl * nv);
  return matt + gloss;
}

BrdfSample scatter(const Reflection& surface, const Eigen::Vector3d& normal, const Eigen::Vector3d& to_viewer,
                   double choice, double u1, double u2) {
  const Eigen::Matrix3d frame = frame_about(normal);
  const Eigen::Vector3d view = frame.transpose() * to_viewer;
  if (view.z() <= 0) return {};
  const double mirror = surface.reflectance == 0 ? 0 : fresnel(surface.reflectance, view.z());
  const double matt = surface.albedo * (1 - mirror);
  if (mirror + matt <= 0) return {};
  const double gloss_share = mirror / (mirror + matt);
  if (choice >= gloss_share) {
    // Cosine-weighted sampling: f_r cos / density is the albedo.
    const double r = std::sqrt(u1), phi = 2 * kPi * u2;
    const Eigen::Vector3d local(r * std::cos(phi), r * std::sin(phi), std::sqrt(std::max(0.0, 1 - u1)));
    const double through = surface.reflectance == 0 ? 1 : 1 - fresnel(surface.reflectance, local.z());
    return {frame * local, matt * through / (1 - gloss_share)};
  }
  const Eigen::Vector3d facet = sample_visible_normal(view, surface.alpha, u1, u2);
  const Eigen::Vector3d local = 2 * view.dot(facet) * facet - view;
  if (local.z() <= 0) return {};
  const double lv = lambda(surface.alpha, view.z()), ll = lambda(surface.alpha, local.z());
  const double weight = fresnel(surface.reflectance, view.dot(facet)) * (1 + lv) / (1 + lv + ll) / gloss_share;
  return {frame * local, weight, true};
}

}  // namespace fringeslam::sim
