// SPDX-License-Identifier: Apache-2.0
// How the brightness of a surface point changes when the camera and the projector move: the projector's irradiance of a
// matt surface, n.l / |l|^3 cos^(v - 3), and the fall-off cos^w of the camera's lens.
#pragma once

#include "core/types/rig_model.h"

namespace fringeslam {

template <class Real>
struct Irradiance {
  Real r[9], t[3];          // projector_from_camera; the rotation by rows
  Real projector_fall_off;  // ProjectorLens::vignetting
  Real camera_fall_off;     // CameraLens::vignetting

  explicit Irradiance(const RigModel& rig)
      : projector_fall_off(static_cast<Real>(rig.projector_lens.vignetting)),
        camera_fall_off(static_cast<Real>(rig.camera_lens.vignetting)) {
    for (int i = 0; i < 9; ++i) r[i] = static_cast<Real>(rig.projector_from_camera.rotation(i / 3, i % 3));
    for (int i = 0; i < 3; ++i) t[i] = static_cast<Real>(rig.projector_from_camera.translation[i]);
  }

  // Derivatives of the logarithm of a point's brightness.
  struct Slope {
    Real by_shift[3];  // displacement of the point, 1/m
    Real by_turn[3];   // rotation vector that turns its surface
  };

  // `p` and `n`: the point and its normal, of either sign and any length, in the camera's axes.
  inline __attribute__((always_inline)) Slope slope(const Real* p, const Real* n) const {
    const Real lx = r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + t[0], ly = r[3] * p[0] + r[4] * p[1] + r[5] * p[2] + t[1],
               lz = r[6] * p[0] + r[7] * p[1] + r[8] * p[2] + t[2];
    // From the projector to the point, in the camera's axes.
    const Real m[3] = {r[0] * lx + r[3] * ly + r[6] * lz, r[1] * lx + r[4] * ly + r[7] * lz,
                       r[2] * lx + r[5] * ly + r[8] * lz};
    const Real facing = 1 / (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]);
    const Real distance = projector_fall_off / (lx * lx + ly * ly + lz * lz), axial = (projector_fall_off - 3) / lz;
    const Real range = camera_fall_off / (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    Slope slope;
    for (int k = 0; k < 3; ++k) slope.by_shift[k] = facing * n[k] - distance * m[k] + axial * r[6 + k] - range * p[k];
    slope.by_shift[2] += camera_fall_off / p[2];
    slope.by_turn[0] = facing * (n[1] * m[2] - n[2] * m[1]);
    slope.by_turn[1] = facing * (n[2] * m[0] - n[0] * m[2]);
    slope.by_turn[2] = facing * (n[0] * m[1] - n[1] * m[0]);
    return slope;
  }
};

}  // namespace fringeslam
