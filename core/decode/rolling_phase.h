// SPDX-License-Identifier: Apache-2.0
// Phase of a moving scene from a rolling window: N consecutive images of an endless sequence of phase shifts of one
// period, with the drift of the phase between images estimated from the images themselves (docs/method.md,
// section 9.6). Needs no calibration and no rigid scene: the drift is a smooth field over the image.
//
// About the reference time of the window, with tau the time in image intervals, a pixel sees
//
//   I_k = A + A' tau_k + B (cos psi_k + h_c cos((N - 1) psi_k) + h_s sin((N - 1) psi_k)),
//   psi_k = phi + delta_k + eps tau_k + a tau_k^2 / 2.
//
// A, A', B and phi belong to the pixel; the drift eps and its change a are smooth over the image; h_c and h_s are the same
// for the whole image. Decoded as if the scene were at rest, three steps have an error of -(eps / sqrt 3) sin 2 phi and
// four steps one of (eps / 2) cos 2 phi, with phi taken at the reference time. The harmonic N - 1 is the first one that N
// steps confuse with the fringe: at rest it causes an error of -h_c sin(N phi) + h_s cos(N phi), and in motion it also
// changes the ripple of four steps, by -3 h_c of its amplitude. Only motion distinguishes it from the shape of
// the surface.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>

#include "core/types/fringe_stack.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct RollingPhaseOptions {
  int neighbours = 1;
  double smoothing_px = 10;
  double harmonic_prior = 0.02;
  int iterations = 5;
  double min_modulation_dn = 3;
  double min_data_modulation = 0.05;
  double saturation = 0.98;
  double max_phase_sigma_rad = 0.2;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("neighbours", neighbours, {0, 16}, "images on each side of the window that help to estimate the drift");
    v.field("smoothing_px", smoothing_px, {1, 200}, "standard deviation of the drift's smoothing window, px");
    v.field("harmonic_prior", harmonic_prior, {0, 0.3},
            "expected amplitude of harmonic N-1 of the fringes relative to the fringes; 0: the fringes are sinusoidal");
    v.field("iterations", iterations, {1, 100}, "Gauss-Newton iterations");
    v.field("min_modulation_dn", min_modulation_dn, {0, 65535}, "minimum modulation B, DN");
    v.field("min_data_modulation", min_data_modulation, {0, 1}, "minimum data modulation B/A");
    v.field("saturation", saturation, {0.1, 1}, "fraction of full scale above which a sample counts as saturated");
    v.field("max_phase_sigma_rad", max_phase_sigma_rad, {0, 3}, "maximum phase sigma, rad");
  }
};

// All images are H x W; NaN at invalid pixels.
struct RollingPhase {
  double reference_time_s = 0;      // mean time of the window's images; phase, mean and modulation are valid then
  size_t first_used = 0, used = 0;  // images of the recording that the result depends on
  cv::Mat1f mean, modulation;       // A and B, DN
  cv::Mat1f wrapped_phase;          // phi, rad, (-pi, pi]
  cv::Mat1f sigma_rad;              // its standard deviation: camera noise, drift and harmonic
  cv::Mat1f drift_rad_s, drift_sigma_rad_s;
  cv::Vec2d harmonic, harmonic_sigma;  // (h_c, h_s), relative to B
};

// Decodes the images first, …, first + steps - 1 of a recording, whose images all show fringes of one period and axis.
// The phase itself comes from these images; the drift, A' and the
// harmonic come from them and from up to `neighbours` images on each
// side, as far as the recording has them. With fewer than six images in all, a is taken as 0; with four, A' also.
// Throws Error if check_stack() does, if the patterns are not fringes of one period, if the window exceeds the
// recording, if the phase shifts of `steps` consecutive images do not determine a phase, if image times do not increase,
// or if there are not more images than steps for fewer than four steps.
RollingPhase decode_rolling_window(const FringeStack& recording, size_t first, int steps, const SensorModel& sensor,
                                   const RollingPhaseOptions& options = {});

}  // namespace fringeslam
