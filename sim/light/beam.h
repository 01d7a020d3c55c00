// SPDX-License-Identifier: Apache-2.0
// The projector's light at points of the world. At a point in the direction theta from the axis, at the distance r,
// a surface under the angle of incidence i receives
//
//   E = E_1 cos^(n-3)(theta) cos(i) / r^2  lux, all pixels on,                                   (1)
//
// E_1 being the illuminance at 1 m on the axis and n the vignetting's exponent. The image there is blurred by
//
//   sigma^2 = sigma_0^2 + (c / 4)^2 px^2,   c = A f |1/z - 1/z_focus|                             (2)
//
// with c the diameter of the circle of confusion of an exit pupil A, whose even disc has the variance (c/4)^2 along
// each axis. Pixels of fill g < 1 are a comb, 1 + sum_k 2 sinc(k g) cos(2 pi k u) exp(-2 pi^2 k^2 sigma^2), along both
// axes: it multiplies the light, since patterns hardly change over a pixel.
#pragma once

#include <memory>

#include "core/types/rig_model.h"
#include "sim/light/effects.h"
#include "sim/light/ray_world.h"
#include "sim/light/shown_patterns.h"

namespace fringeslam::sim {

// How the projector lights the points of a packet, before shadows.
struct BeamPacket {
  alignas(64) double column[kPacket], row[kPacket];  // projector coordinates, px
  Points to_light;                                   // unit
  double distance[kPacket];                          // to the projector, m
  float lux[kPacket];                                // on a surface that faces the projector, eq. 1 without cos(i)
  float blur_px[kPacket];                            // sigma, eq. 2
  Lanes inside = 0;                                  // within the projector's image
};

struct BeamKernel;

class Beam {
 public:
  Beam(const RigModel& rig, const Effects& effects, const Pose& world_from_camera);

  const Eigen::Vector3d& position() const { return position_; }
  void light(const Points& points, Lanes active, BeamPacket& result) const;

  // Blurs between the given distances from the projector.
  static BlurRange blur_range(const RigModel& rig, const Effects& effects, double near_m, double far_m);

 private:
  std::shared_ptr<BeamKernel> kernel_;
  double excess_falloff_ = 0;  // n - 3
  Eigen::Vector3d position_;
};

}  // namespace fringeslam::sim
