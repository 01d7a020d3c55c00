// SPDX-License-Identifier: Apache-2.0
// Calibrates the projector's response: emitted light as a function of the input level (docs/method.md, sections 3.3 and
// 11.3). A nonlinear response adds harmonics to the fringes, which bias three-step phase: by about 0.29 rad sin 3 phi
// for a gamma of 2.2.
//
// Two methods. Grey ramp, per pixel: light_k = (I_k - I_black) / (I_white - I_black). Many-step fringes: N steps give a
// phase nearly free of harmonics and thereby each image's ideal level 1/2 + 1/2 cos(phi + delta_k); grey values plotted
// against ideal levels are the response, up to an offset and a scale per pixel.
//
// Sequences with three or more steps of several periods show the harmonics, too: they make the phase of a coarse period
// deviate from that of the next finer one, as a function of the phase.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct ResponseOptions {
  int entries = 257;
  double min_contrast_dn = 30;  // white minus black
  double saturation = 0.95;     // of full scale
  int min_pixels = 1000;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("entries", entries, {3, 4097}, "entries of the response table");
    v.field("min_contrast_dn", min_contrast_dn, {1, 65535},
            "minimum difference between a pixel's white and black grey values, DN");
    v.field("saturation", saturation, {0.1, 1}, "fraction of full scale above which a pixel counts as saturated");
    v.field("min_pixels", min_pixels, {10, 100000000}, "minimum number of usable pixels");
  }
};

struct Response {
  std::vector<double> level, light, sigma;  // measured input level, output and its standard deviation
  std::vector<double> table;                // light at equally spaced levels from 0 to 1, increasing
  int pixels = 0;
  double gamma = 0;  // exponent of the best-fitting power law
};

// Estimates the response from flat images (DN, H x W each) of the given levels, which must include black and white.
// Throws Error if images and levels do not match, too few pixels are usable, or the light decreases with the level.
Response response_from_ramp(const std::vector<cv::Mat1f>& images, const std::vector<double>& levels,
                            const SensorModel& sensor, const ResponseOptions& options);

// Estimates the response from images (DN, H x W each) of one fringe period in N >= 8 equally spaced steps. Throws Error
// if the steps are not equally spaced, too few images, pixels or phases are available or the light decreases with the level.
Response response_from_fringes(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                               const SensorModel& sensor, const ResponseOptions& options);

// Estimates the phase error of a `steps`-step measurement from N >= 8 equally spaced images, N a multiple of `steps`.
// The phase of every (N / steps)-th image minus the N-step phase is averaged over pixels of equal phase. Throws Error as
// response_from_fringes() does.
PhaseCorrection phase_correction_from_fringes(const std::vector<cv::Mat1f>& images,
                                              const std::vector<double>& shifts_rad, int steps,
                                              const SensorModel& sensor, const ResponseOptions& options);

// How the phase of one period deviates from that of the next finer one of the same axis.
struct PeriodDeviation {
  double period_px = 0;
  PhaseCorrection correction;  // deviation that repeats with the phase; its steps are those of the period
  double sigma_rad = 0;        // standard deviation of the table's entries
  double rms_rad = 0;          // of the correction
  double gamma = 1;            // of the power law that causes a correction of that size
  int64_t pixels = 0;

  double rms_px() const;
};

// Measures the deviations of all periods but the finest, coarsest first, from images (DN, H x W each) of a sequence whose
// coarsest period covers the projector's image. Empty if it does not, or if the steps of a period are not equally spaced;
// ends at the first period with fewer than `options.min_pixels` usable pixels.
std::vector<PeriodDeviation> period_deviations(const std::vector<cv::Mat>& images, const PatternSequence& sequence,
                                               Axis axis, const SensorModel& sensor, const ResponseOptions& options);

// Returns the power law that the deviations show, weighted by their pixels, as a response. Throws Error without
// deviations.
Response response_from_deviations(const std::vector<PeriodDeviation>& deviations, const ResponseOptions& options);

}  // namespace fringeslam
