// SPDX-License-Identifier: Apache-2.0
#include "sim/light/photometry.h"

#include <cmath>

namespace fringeslam::sim {

double camera_pupil_m(const RigModel& rig) {
  const CameraLens& lens = rig.camera_lens;
  const double image_distance_m = lens.pixel_m * rig.camera.fx;
  return 1 / (1 / image_distance_m + 1 / lens.focus_m) / lens.f_number;
}

double photons_per_lux_s(const RigModel& rig) {
  constexpr double kPlanckTimesLight = 6.62607015e-34 * 299792458;  // J m
  const double pupil_m = camera_pupil_m(rig);
  const double lumens = pupil_m * pupil_m / 4 / (rig.camera.fx * rig.camera.fy) * rig.camera_lens.transmission;
  return lumens * rig.projector_lens.wavelength_m / (kPlanckTimesLight * rig.projector_lens.efficacy_lm_w);
}

double projector_lux_at_1m(const RigModel& rig) {
  const Pinhole& p = rig.projector;
  constexpr int kGrid = 64;
  double area = 0;  // on the plane z = 1 m, weighted by vignetting
  for (int i = 0; i < kGrid; ++i) {
    for (int j = 0; j < kGrid; ++j) {
      const double x = (p.width * (i + 0.5) / kGrid - 0.5 - p.cx) / p.fx;
      const double y = (p.height * (j + 0.5) / kGrid - 0.5 - p.cy) / p.fy;
      area += std::pow(1 + x * x + y * y, -rig.projector_lens.vignetting / 2);
    }
  }
  area *= p.width / p.fx * p.height / p.fy / (kGrid * kGrid);
  return rig.projector_lens.flux_lm / area;
}

double white_electrons_at_1m(const RigModel& rig) {
  return projector_lux_at_1m(rig) * photons_per_lux_s(rig) * rig.timing.exposure_s * rig.sensor.quantum_efficiency;
}

}  // namespace fringeslam::sim
