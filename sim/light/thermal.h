// SPDX-License-Identifier: Apache-2.0
// What the rig's thermal camera sees. A sample that meets a surface of emissivity e brings, in the band of
// sim/light/infrared.h,
//
//   L = t (e B(T) + (1 - e) B(T_0)) + (1 - t) B(T_0),  t = exp(-infrared_share extinction distance)
//
// with B a black body's radiance and T_0 the temperature of the surroundings, which surfaces reflect and the air has:
// hot things are not seen mirrored in others. Where dust lies it is the dust's temperature that counts. The mean over a
// pixel's samples, blurred by the lens, with noise, is given as apparent temperature.
#pragma once

#include <opencv2/core.hpp>

#include "core/types/truth.h"
#include "sim/light/sample_rays.h"
#include "sim/light/surfaces.h"

namespace fringeslam::sim {

struct ThermalImaging {
  bool noise = true;
  bool quantise = true;  // to hundredths of a kelvin
};

// Of the thermal camera. The rig must have one.
SampleRays thermal_rays(const RigModel& rig, int per_pixel = 9);

// Apparent temperatures, degrees C, of the thermal camera's pixels, by its rays. `stack` keys the noise.
cv::Mat1f thermal_image(const Scene& scene, const SampleRays& rays, const RayWorld& world, const Surfaces& surfaces,
                        const Effects& effects, const Pose& world_from_camera, int stack,
                        const ThermalImaging& imaging);

// Adds kTruthThermal to the mask where the thermal camera sees what a pixel sees.
void mark_thermally_seen(TruthFrame& truth, const Scene& scene, const RayWorld& world, const Pose& world_from_camera);

}  // namespace fringeslam::sim
