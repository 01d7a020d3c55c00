// SPDX-License-Identifier: Apache-2.0
// From lumens to photons. Light in a scene is counted in lux: the illuminance of a surface, and what a surface sends
// back as that of the white Lambertian board which would look the same, W = pi L. A pixel of pitch a behind a lens of
// pupil D at the image distance f' = a fx then collects, at the field angle theta,
//
//   photons = W (D^2 / 4) (a / f')^2 tau cos^n(theta) t  lambda / (h c K)                (1)
//
// since it receives L (pi D^2 / 4) (a / f')^2 lumens; tau is the lens' transmission, t the exposure, and K lm/W and
// lambda the light's efficacy and mean wavelength. The pupil is f / N with 1 / f = 1 / f' + 1 / focus.
#pragma once

#include "core/types/rig_model.h"

namespace fringeslam::sim {

// Diameter of the camera's entrance pupil, m.
double camera_pupil_m(const RigModel& rig);

// Photons a pixel on the axis collects for each lux s of W, eq. 1.
double photons_per_lux_s(const RigModel& rig);

// Illuminance that a white projector image makes on a screen facing it at 1 m, on the axis, lux: the flux over the
// image's area there, weighted by the vignetting.
double projector_lux_at_1m(const RigModel& rig);

// Electrons of one exposure from a white board facing the projector at 1 m.
double white_electrons_at_1m(const RigModel& rig);

}  // namespace fringeslam::sim
