// SPDX-License-Identifier: Apache-2.0
// The calibrated rig: camera, projector, their relative pose, the pose on the robot, and the camera's noise parameters.
// Read from rig.yaml (core/rig/rig_file.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Camera parameters as defined by EMVA 1288. The grey value y (digital number, DN) of n collected electrons is y =
// offset_dn + gain_dn_per_electron * n, clipped to [0, 2^bits - 1] and rounded.
struct SensorModel {
  int bits = 8;
  double gain_dn_per_electron = 1.0 / 150.0;  // EMVA's overall system gain K
  double dark_noise_electrons = 25.0;         // temporal, standard deviation
  double full_well_electrons = 40000.0;       // saturation capacity
  double offset_dn = 2.0;                     // black level
  double quantum_efficiency = 0.5;            // electrons per photon, averaged over the projector's spectrum
  double dark_current_electrons_s = 0.0;      // mean
  double dsnu_electrons = 0.0;                // dark signal non-uniformity, standard deviation over the pixels
  double prnu = 0.0;                          // photo response non-uniformity, relative standard deviation

  double max_dn() const { return static_cast<double>((1 << bits) - 1); }

  // Returns the gray value at which the camera clips: full scale, or that of a full well that is reached before.
  double saturation_dn() const {
    const double well_dn = offset_dn + gain_dn_per_electron * full_well_electrons;
    return gain_dn_per_electron > 0 && well_dn < max_dn() ? well_dn : max_dn();
  }

  // Returns the temporal variance of a grey value in DN^2: K^2 sigma_d^2 + K (y - offset) + 1/12 (EMVA 1288 eq. 9).
  double variance_dn2(double grey_dn) const {
    const double signal = grey_dn > offset_dn ? grey_dn - offset_dn : 0.0;
    return gain_dn_per_electron * gain_dn_per_electron * dark_noise_electrons * dark_noise_electrons +
           gain_dn_per_electron * signal + 1.0 / 12.0;
  }
};

// Phase error that a nonlinear projector response causes for N equally spaced steps: offset at equally spaced true
// phases over one turn, starting at 0, to be subtracted from the measured phase. Empty: no correction.
struct PhaseCorrection {
  int steps = 0;
  std::vector<double> offset_rad;
};

// Lens properties other than the projection geometry. The simulator uses all of them. Motion compensation uses `vignetting`,
// and the correction of points beside texture uses `blur_px` and, if they have been stated, `pixel_m`, `f_number` and `focus_m`
// of the camera.
struct CameraLens {
  double pixel_m = 10e-6;     // pitch of the sensor's pixels
  double f_number = 8;        // focal length / entrance pupil diameter
  double focus_m = 1;         // distance in focus
  double transmission = 0.9;  // of light, including the pixel fill factor
  double blur_px = 0;         // in-focus point spread, standard deviation
  double vignetting = 4;      // n of the image illuminance fall-off cos^n over the field angle; 4 is the natural law
};
struct ProjectorLens {
  double aperture_m = 0;  // exit pupil diameter; 0: in focus at all distances
  double focus_m = 1;     // distance in focus
  double blur_px = 0;     // in-focus point spread, standard deviation, projector px
  double pixel_fill = 1;  // lit fraction of the pixel width
  double vignetting = 3;  // n of the fall-off cos^n on a flat screen; 3: equal radiant intensity in all directions
  double flux_lm = 2500;  // luminous flux with all pixels on
  // Photons per second per lumen = wavelength / (h c efficacy).
  double efficacy_lm_w = 300, wavelength_m = 550e-9;
};

// The projector shows each pattern for 1 / pattern_rate_hz; the camera takes one image every 1 / camera_rate_hz.
struct Timing {
  double pattern_rate_hz = 360, camera_rate_hz = 90;
  double exposure_s = 1.0 / 360;
};

// Uncooled long-wave infrared camera (8 to 14 um). It measures apparent temperature: that of a black body of equal
// radiance.
struct ThermalCamera {
  Pinhole lens;
  Pose thermal_from_camera;
  double netd_k = 0.05;                     // noise-equivalent temperature difference at 300 K, standard deviation
  double blur_px = 0.5;                     // point spread, standard deviation
  double coldest_c = -40, hottest_c = 330;  // measurement range; values saturate at its ends
};

struct RigModel {
  std::string name;
  // False if intrinsics and poses are nominal: usable as initial values for calibration, not for measurement.
  bool calibrated = true;
  Pinhole camera;
  Pinhole projector;
  Pose projector_from_camera;
  Pose robot_from_camera;
  SensorModel sensor;
  CameraLens camera_lens = {};
  ProjectorLens projector_lens = {};
  Timing timing = {};
  double projector_black_level = 0.002;  // light with all pixels off relative to all pixels on
  // Light output, normalised to 0 (black) to 1 (white), at equally spaced input levels from 0 to 1; increasing. Empty:
  // linear.
  std::vector<double> projector_response = {};
  PhaseCorrection phase_correction = {};
  double near_m = 0.7, far_m = 1.4;  // working range along the camera's z
  double middle_range_m() const { return 0.5 * (near_m + far_m); }
  // Edge of the square that a pixel covers on a surface at mid range, facing the camera.
  double pixel_footprint_m() const { return 2 * middle_range_m() / (camera.fx + camera.fy); }
  std::optional<ThermalCamera> thermal = {};
};

}  // namespace fringeslam
