// SPDX-License-Identifier: Apache-2.0
// Photometric conversions from lumens to photons (docs/method.md, section 12.2). Light is expressed in lux: a surface
// receives an illuminance, and its luminance L is given as W = pi L, the illuminance of a white Lambertian board of
// equal luminance. At the field angle theta, a pixel of pitch a behind an entrance pupil D collects, at the image
// distance f' = a fx,
//
//   photons = W (D^2 / 4) (a / f')^2 tau cos^n(theta) t  lambda / (h c K)                (1)
//
// since it receives L (pi D^2 / 4) (a / f')^2 lumens. tau is the lens transmission, t the exposure, K (lm/W) the
// luminous efficacy and lambda the mean wavelength of the light. The pupil is D = f / N with
// 1 / f = 1 / f' + 1 / focus.
#pragma once

#include "core/types/rig_model.h"

namespace fringeslam::sim {

// Returns the photons that an on-axis pixel collects per lux s of W (eq. 1).
double photons_per_lux_s(const RigModel& rig);

// Returns the on-axis illuminance, lux, of a white projector image on a perpendicular screen at 1 m: the flux divided
// by the vignetting-weighted image area.
double projector_lux_at_1m(const RigModel& rig);

// Returns the electrons per on-axis pixel and exposure from a white board facing the projector at 1 m.
double white_electrons_at_1m(const RigModel& rig);

}  // namespace fringeslam::sim
