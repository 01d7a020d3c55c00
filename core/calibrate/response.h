// SPDX-License-Identifier: Apache-2.0
// The projector's response: its light as a function of its input (METHOD §1, response curve). A response that is not
// linear puts harmonics into the fringes, which three steps take for phase: about 0.29 rad sin 3 phi for a gamma
// of 2.2.
//
// From a grey ramp, pixel by pixel: light_k = (I_k - I_black) / (I_white - I_black). From many-step fringes: N steps
// give the phase nearly free of harmonics, with it each image's ideal level 1/2 + 1/2 cos(phi + delta_k), and the grey
// values against the ideal levels are the response, up to an offset and a scale that differ from pixel to pixel.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

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
            "least difference of white and black of a pixel, grey values");
    v.field("saturation", saturation, {0.1, 1}, "share of full scale above which a pixel counts as clipped");
    v.field("min_pixels", min_pixels, {10, 100000000}, "least number of pixels that can be used");
  }
};

struct Response {
  std::vector<double> level, light, sigma;  // as measured: input, output, its standard deviation
  std::vector<double> table;                // light at equally spaced levels from 0 to 1, growing
  int pixels = 0;
  double gamma = 0;  // of the power law nearest to it
};

// Grey values (DN, H x W each) of flat images of the given levels, black and white among them. Throws Error saying what
// is wrong with images from which no response can be had.
Response response_from_ramp(const std::vector<cv::Mat1f>& images, const std::vector<double>& levels,
                            const SensorModel& sensor, const ResponseOptions& options);

// Images of one fringe period in N >= 8 equally spaced steps.
Response response_from_fringes(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                               const SensorModel& sensor, const ResponseOptions& options);

// What `steps` equally spaced steps measure too much, from N >= 8 images of which they are every (N / steps)-th: the
// difference of the two phases, averaged over pixels of the same phase.
PhaseCorrection phase_correction_from_fringes(const std::vector<cv::Mat1f>& images,
                                              const std::vector<double>& shifts_rad, int steps,
                                              const SensorModel& sensor, const ResponseOptions& options);

}  // namespace fringeslam
