// SPDX-License-Identifier: Apache-2.0
// Projector model: light at points of the scene (docs/method.md, section 12.1). With all pixels on, a surface at
// distance r, off-axis angle theta and angle of incidence i receives the illuminance
//
//   E = E_1 cos^(n-3)(theta) cos(i) / r^2  lux,                                                  (1)
//
// where E_1 is the on-axis illuminance at 1 m and n the vignetting exponent. The projected image is blurred with
//
//   sigma^2 = sigma_0^2 + (c / 4)^2 px^2,   c = A f |1/z - 1/z_focus|                             (2)
//
// where c is the diameter, px, of the circle of confusion for the exit-pupil diameter A; a uniform disc of diameter c
// has the variance (c/4)^2 along each axis. Pixels with a fill factor g < 1 modulate the light along both axes by the
// comb 1 + sum_k 2 sinc(k g) cos(2 pi k u) exp(-2 pi^2 k^2 sigma^2), since patterns are nearly constant over a pixel.
#pragma once

#include <memory>

#include "core/types/rig_model.h"
#include "sim/light/effects.h"
#include "sim/light/projected_patterns.h"
#include "sim/light/ray_scene.h"

namespace fringeslam::sim {

// Illumination of a packet's points by the projector, without shadows.
struct BeamPacket {
  alignas(64) double column[kPacket], row[kPacket];  // projector coordinates, px
  Points to_light;                                   // unit vector
  double distance[kPacket];                          // to the projector, m
  float lux[kPacket];                                // at normal incidence: eq. 1 without cos(i)
  float blur_px[kPacket];                            // sigma, eq. 2
  LaneMask inside = 0;                               // within the projector's image
};

struct BeamKernel;

class Beam {
 public:
  Beam(const RigModel& rig, const Effects& effects, const Pose& world_from_camera);

  // Projector centre in the world frame, m.
  const Eigen::Vector3d& position() const { return position_; }
  // Computes the illumination of world points; `inside` is restricted to the active lanes.
  void light(const Points& points, LaneMask active, BeamPacket& result) const;

  // Returns the range of blur sigmas, px, between two distances from the projector.
  static BlurRange blur_range(const RigModel& rig, const Effects& effects, double near_m, double far_m);

 private:
  std::shared_ptr<BeamKernel> kernel_;
  double excess_falloff_ = 0;  // n - 3
  Eigen::Vector3d position_;
};

}  // namespace fringeslam::sim
