// SPDX-License-Identifier: Apache-2.0
// Verifies from the images alone that a sequence shows the requested patterns. A dropped, repeated or shifted image
// cannot be recognised on its own.
//
// With each sequence, an all-white image W and an all-black image K are captured. A pixel with sufficient contrast sees
// every pattern between the two: (I - K) / (W - K) is the pattern's level v at the pixel's projector coordinate. Hence
//
//   flat    v is 0 or 1 of black and white, and grows with the level;
//   gray    v is 0 or 1, and a bit and its inverse are opposite where both are shown;
//   fringe  the mean of the N images of a period is the same at all pixels and for all periods; N > 3 images fit a
//           cosine, and each differs from the one before it as the cosine does, summed over all pixels; and the phase of
//           a finer period equals the phase of the coarser one times the ratio of the periods, up to whole turns;
//   extra, product
//           v is the pattern's level at the coordinate that the fringes give. Without such fringes, v differs from black,
//           from white and from that of all other images by more than noise.
//
// A wrong pattern violates one of these conditions at most pixels. If the projector's light is the gamma'th power of
// the grey value, fringes are not cosines and their mean is not 1/2 but (s: fringe phase)
//
//   mean over a turn of (1/2 + cos(s)/2)^gamma = Gamma(2 gamma + 1) / (4^gamma Gamma(gamma + 1)^2).
//
// The mean therefore determines gamma, with which the levels are linearised before phases are compared.
#pragma once

#include <string>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

struct SequenceCheckOptions {
  double full_scale_dn = 255;      // of the camera
  double min_contrast = 0.047;     // white minus black relative to full scale, for a pixel to be used
  double saturation = 0.98;        // relative to full scale; brighter pixels are not used
  double tolerance = 0.12;         // of a level that should be 0 or 1
  double mean_tolerance = 0.08;    // of the mean of a period's images
  double cosine_tolerance = 0.15;  // root of the summed squared residuals of the cosine fit, unless they are noise
  double max_outliers = 0.25;      // allowed share of violating pixels: edges, interreflection, gloss
  double min_pixels = 0.02;        // required share of pixels with sufficient contrast
};

struct SequenceVerdict {
  bool good = false;
  std::string reason;           // if not good: a clause that names the image
  double gamma = 1;             // of the projector, from the fringes' mean; 1 if no evenly spaced fringes
  bool too_few_pixels = false;  // the images could not be checked
  bool saturated = false;       // the images could not be checked because white saturates
};

// The gamma whose fringes have this mean level. Throws Error if it is below 0.25 (gamma 4.7) or above 0.75 (gamma
// 0.25).
double gamma_of_mean(double mean);

// Checks the images of `sequence`, in its order; white and black are captured with all projector pixels on and off.
SequenceVerdict check_sequence(const PatternSequence& sequence, const std::vector<cv::Mat>& images,
                               const cv::Mat& white, const cv::Mat& black, const SequenceCheckOptions& options = {});

}  // namespace fringeslam
