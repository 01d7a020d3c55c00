// SPDX-License-Identifier: Apache-2.0
// The calibrated sensor: camera, projector, their relative pose, the mount on the robot, and the
// camera's noise figures. Read from rig.yaml (core/rig/rig_file.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Camera figures in the terms of EMVA 1288. A grey value y (digital number, DN) of n collected
// electrons is y = offset_dn + gain_dn_per_electron * n, clipped to [0, 2^bits - 1] and rounded.
struct SensorModel {
  int bits = 8;
  double gain_dn_per_electron = 1.0 / 150.0;  // EMVA's overall system gain K
  double dark_noise_electrons = 25.0;         // temporal, standard deviation
  double full_well_electrons = 40000.0;       // saturation capacity
  double offset_dn = 2.0;                     // black level
  double quantum_efficiency = 0.5;            // electrons a photon, over the projector's light
  double dark_current_electrons_s = 0.0;      // mean
  double dsnu_electrons = 0.0;                // dark signal nonuniformity, standard deviation over the pixels
  double prnu = 0.0;                          // photo response nonuniformity, the same, as a fraction

  double max_dn() const { return static_cast<double>((1 << bits) - 1); }

  // Temporal variance of a grey value, DN^2: K^2 sigma_d^2 + K (y - offset) + 1/12 (EMVA 1288 eq. 9).
  double variance_dn2(double grey_dn) const {
    const double signal = grey_dn > offset_dn ? grey_dn - offset_dn : 0.0;
    return gain_dn_per_electron * gain_dn_per_electron * dark_noise_electrons * dark_noise_electrons +
           gain_dn_per_electron * signal + 1.0 / 12.0;
  }
};

// What a projector whose light is no linear function of its input does to the phase of N equally spaced steps: offset
// at equally spaced true phases over one turn, from 0, to be subtracted from the measured phase. Empty: none.
struct PhaseCorrection {
  int steps = 0;
  std::vector<double> offset_rad;
};

// What lenses do beside projecting. Only the simulator reads this: decoding needs none of it.
struct CameraLens {
  double pixel_m = 10e-6;     // pitch of the sensor's pixels
  double f_number = 8;        // focal length over entrance pupil
  double focus_m = 1;         // distance in focus
  double transmission = 0.9;  // of light, and the pixels' fill factor
  double blur_px = 0;         // point spread in focus, standard deviation
  double vignetting = 4;      // illuminance of the image falls with the field angle as cos^n; 4 is the natural law
};
struct ProjectorLens {
  double aperture_m = 0;  // exit pupil; 0: in focus everywhere
  double focus_m = 1;     // distance of the screen in focus
  double blur_px = 0;     // point spread there, standard deviation, projector px
  double pixel_fill = 1;  // of a pixel's width that gives light; the rest is gap
  double vignetting = 3;  // illuminance of a flat screen falls as cos^n; 3: the same light in all directions
  double flux_lm = 2500;  // luminous flux, all pixels on
  // What camera sees of it: photons a second and lumen are wavelength / (h c efficacy).
  double efficacy_lm_w = 300, wavelength_m = 550e-9;
};

// The projector shows a pattern for 1 / pattern_rate_hz; the camera takes one image every 1 / camera_rate_hz.
struct Timing {
  double pattern_rate_hz = 360, camera_rate_hz = 90;
  double exposure_s = 1.0 / 360;
};

// An uncooled thermal camera beside the others, of the long-wave infrared (8 to 14 um). What it says is the apparent
// temperature: that of a black body of the same radiance.
struct ThermalCamera {
  Pinhole lens;
  Pose thermal_from_camera;
  double netd_k = 0.05;                     // noise-equivalent temperature difference at 300 K, standard deviation
  double blur_px = 0.5;                     // point spread, standard deviation
  double coldest_c = -40, hottest_c = 330;  // saturates there
};

struct RigModel {
  std::string name;
  // False when lenses and poses are nominal: good to calibrate with, not to measure with.
  bool calibrated = true;
  Pinhole camera;
  Pinhole projector;
  Pose projector_from_camera;
  Pose robot_from_camera;
  SensorModel sensor;
  CameraLens camera_lens = {};
  ProjectorLens projector_lens = {};
  Timing timing = {};
  double projector_black_level = 0.002;  // light with every pixel off over light with every pixel on
  // Light, black to white as 0 to 1, at equally spaced input levels from 0 to 1; growing. Empty: linear.
  std::vector<double> projector_response = {};
  PhaseCorrection phase_correction = {};
  double near_m = 0.7, far_m = 1.4;  // working range along the camera's z
  std::optional<ThermalCamera> thermal = {};
};

}  // namespace fringeslam
