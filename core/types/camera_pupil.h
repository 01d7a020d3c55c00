// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/types/rig_model.h"

namespace fringeslam {

// Returns the diameter of the camera's entrance pupil: focal length / f-number, by the thin-lens equation, m.
inline double camera_pupil_m(const RigModel& rig) {
  const CameraLens& lens = rig.camera_lens;
  const double image_distance_m = lens.pixel_m * rig.camera.fx;
  return 1 / (1 / image_distance_m + 1 / lens.focus_m) / lens.f_number;
}

// Returns true if the aperture and focus of the lens are stated, so that its defocus is known. Rigs of real captures often lack them.
inline bool states_defocus(const CameraLens& lens) {
  const CameraLens nominal;
  return lens.pixel_m != nominal.pixel_m || lens.f_number != nominal.f_number || lens.focus_m != nominal.focus_m;
}

}  // namespace fringeslam
