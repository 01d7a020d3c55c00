// SPDX-License-Identifier: Apache-2.0
// Thermal camera model (docs/method.md, section 10). A sample that hits a surface of emissivity e contributes, in the
// band of sim/light/infrared.h, the radiance
//
//   L = t (e B(T) + (1 - e) B(T_0)) + (1 - t) B(T_0),  t = exp(-infrared_share extinction distance)
//
// where B is the black-body radiance and T_0 the temperature of the air and of the surroundings reflected by surfaces;
// reflections of hot objects are not modelled. Dust-covered areas radiate at the temperature of the dust. The mean over
// a pixel's samples, with lens blur and noise, is converted to apparent temperature.
#pragma once

#include <opencv2/core.hpp>

#include "core/types/truth.h"
#include "sim/light/sample_rays.h"
#include "sim/light/surfaces.h"

namespace fringeslam::sim {

struct ThermalImaging {
  bool noise = true;
  bool quantise = true;  // in steps of 0.01 K
};

// Computes the thermal camera's sample rays. The rig must have a thermal camera.
SampleRays thermal_rays(const RigModel& rig, const Effects& effects, int per_pixel = 9);

// Renders the apparent temperatures, degrees C, of the thermal camera's pixels; `stack` keys the noise.
cv::Mat1f thermal_image(const Scene& scene, const SampleRays& rays, const RayScene& world, const Surfaces& surfaces,
                        const Effects& effects, const Pose& world_from_camera, int stack,
                        const ThermalImaging& imaging);

// Sets kTruthThermal in the mask where the thermal camera sees the pixel's surface point.
void mark_thermal_visibility(TruthFrame& truth, const Scene& scene, const RayScene& world,
                             const Pose& world_from_camera);

}  // namespace fringeslam::sim
