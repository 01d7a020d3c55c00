// SPDX-License-Identifier: Apache-2.0
#include "sim/light/beam.h"

#include <cmath>
#include <numbers>

#include "sim/light/photometry.h"

namespace fringeslam::sim {

namespace {

constexpr double kPi = std::numbers::pi;

double blur_at(const ProjectorLens& lens, double fx, double z) {
  const double circle_px = lens.aperture_m * fx * std::abs(1 / z - 1 / lens.focus_m);
  return std::sqrt(lens.blur_px * lens.blur_px + circle_px * circle_px / 16);
}

// The comb of pixels of the given fill, blurred; its mean is 1.
float comb(double coordinate, double fill, double sigma) {
  // Even the sharpest lens leaves no more than three harmonics.
  const double blur = std::max(sigma, 0.2);
  double sum = 1;
  for (int k = 1; k <= 3; ++k) {
    const double harmonic = 2 * std::sin(kPi * k * fill) / (kPi * k * fill);
    sum += harmonic * std::exp(-2 * kPi * kPi * k * k * blur * blur) * std::cos(2 * kPi * k * coordinate);
  }
  return static_cast<float>(sum);
}

}  // namespace

Beam::Beam(const RigModel& rig, const Effects& effects, const Pose& world_from_camera)
    : projector_(rig.projector),
      lens_(rig.projector_lens),
      defocus_(effects.defocus),
      gap_(effects.pixel_gap && rig.projector_lens.pixel_fill < 1),
      vignetting_(effects.vignetting && rig.projector_lens.vignetting != 3),
      lux_at_1m_(projector_lux_at_1m(rig)),
      projector_from_world_(rig.projector_from_camera * world_from_camera.inverse()),
      position_(projector_from_world_.inverse().translation) {}

void Beam::light(const Points& points, Lanes active, BeamPacket& result) const {
  const Eigen::Matrix3d& r = projector_from_world_.rotation;
  const Eigen::Vector3d& t = projector_from_world_.translation;
  const Pinhole p = projector_;
  const Distortion d = p.distortion;
  alignas(64) double z[kPacket], cosine[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    const double px = points.x[i], py = points.y[i], pz = points.z[i];
    const double tx = position_.x() - px, ty = position_.y() - py, tz = position_.z() - pz;
    const double distance = std::sqrt(tx * tx + ty * ty + tz * tz);
    result.distance[i] = distance;
    result.to_light.x[i] = tx / distance;
    result.to_light.y[i] = ty / distance;
    result.to_light.z[i] = tz / distance;
    z[i] = r(2, 0) * px + r(2, 1) * py + r(2, 2) * pz + t.z();
    cosine[i] = z[i] / distance;
    const double x = (r(0, 0) * px + r(0, 1) * py + r(0, 2) * pz + t.x()) / z[i];
    const double y = (r(1, 0) * px + r(1, 1) * py + r(1, 2) * pz + t.y()) / z[i];
    const double r2 = x * x + y * y;
    const double radial = 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
    result.column[i] = p.fx * (x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)) + p.cx;
    result.row[i] = p.fy * (y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y) + p.cy;
    result.lux[i] = static_cast<float>(lux_at_1m_ / (distance * distance));
    result.blur_px[i] = 0;
  }
  result.inside = 0;
  for (int i = 0; i < kPacket; ++i) {
    const bool inside = has(active, i) && z[i] > 0 && p.contains({result.column[i], result.row[i]});
    result.inside |= static_cast<Lanes>(inside) << i;
    if (!inside) continue;
    if (vignetting_) result.lux[i] *= static_cast<float>(std::pow(cosine[i], lens_.vignetting - 3));
    if (defocus_) result.blur_px[i] = static_cast<float>(blur_at(lens_, p.fx, z[i]));
    if (gap_) {
      const auto blur = static_cast<double>(result.blur_px[i]);
      result.lux[i] *= comb(result.column[i], lens_.pixel_fill, blur) * comb(result.row[i], lens_.pixel_fill, blur);
    }
  }
}

double Beam::largest_blur_px(const RigModel& rig, const Effects& effects, double near_m, double far_m) {
  if (!effects.defocus) return 0;
  const double fx = rig.projector.fx;
  return std::max(blur_at(rig.projector_lens, fx, near_m), blur_at(rig.projector_lens, fx, far_m));
}

}  // namespace fringeslam::sim
