// SPDX-License-Identifier: Apache-2.0
// The calibrated sensor: camera, projector, their relative pose, the mount on the robot, and the
// camera's noise figures. Read from rig.yaml (core/rig/rig_file.h).
#pragma once

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

struct RigModel {
  std::string name;
  // False when lenses and poses are nominal: good to calibrate with, not to measure with.
  bool calibrated = true;
  Pinhole camera;
  Pinhole projector;
  Pose projector_from_camera;
  Pose robot_from_camera;
  SensorModel sensor;
  // Electrons that one exposure collects from a white Lambertian board facing the projector, 1 m
  // away, with every projector pixel on. Black level: the same with every pixel off, as a fraction.
  double white_electrons_at_1m = 30000.0;
  double projector_black_level = 0.002;
  // Light, black to white as 0 to 1, at equally spaced input levels from 0 to 1; growing. Empty: linear.
  std::vector<double> projector_response = {};
  PhaseCorrection phase_correction = {};
  double near_m = 0.7, far_m = 1.4;  // working range along the camera's z
};

}  // namespace fringeslam
