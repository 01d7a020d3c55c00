// SPDX-License-Identifier: Apache-2.0
// Measures a camera's noise from fringe stacks by photon transfer (docs/method.md, section 11.4; EMVA 1288): the
// temporal variance of a grey value y is K y + c, with the gain K in DN per electron.
//
// A fringe stack needs no repeated images. Its N images follow a linear model with fewer parameters than images: all
// periods share the mean A, I_k = A + a_g cos delta_k - b_g sin delta_k, and a Gray code image and its inverse add up to
// white plus black. An orthonormal basis of the model's residual space turns the N samples of a pixel into N - p
// independent noise samples, each of variance K mu + c, where mu is the mean of the pixel's grey values weighted by the
// squared coefficients. Repeated stacks of a static view add the differences of equal images.
//
// Two kinds of deterministic residuals are estimated by regression and removed: the brightness of each image
// (flicker), and harmonics of each period's waveform (nonlinear projector).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/types/fringe_stack.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct NoiseOptions {
  int bins = 32;
  int min_bin_samples = 200;
  int min_samples = 5000;
  double saturation = 0.95;
  int max_pixels = 100000;
  double max_correlation = 0.3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("bins", bins, {4, 1000}, "bins of grey value");
    v.field("min_bin_samples", min_bin_samples, {20, 1000000}, "minimum number of noise samples in a bin");
    v.field("min_samples", min_samples, {1000, 100000000}, "minimum number of noise samples");
    v.field("saturation", saturation, {0.1, 1}, "fraction of full scale above which a sample is not used");
    v.field("max_pixels", max_pixels, {1000, 100000000}, "pixels used per stack, spread over the image");
    v.field("max_correlation", max_correlation, {0.01, 1},
            "maximum correlation of the difference of two images between neighbouring pixels; above it, the view "
            "counts as moved");
  }
};

// Estimate and the limits of its 95 % confidence interval.
struct NoiseInterval {
  double value = 0, low = 0, high = 0;
};

// Noise of the grey values between two limits.
struct NoiseBin {
  double grey_dn = 0, variance_dn2 = 0;  // means
  int64_t samples = 0;
};

struct CameraNoise {
  SensorModel sensor;  // of `prior` with the measured parameters
  NoiseInterval gain_dn_per_electron, dark_noise_electrons, offset_dn;
  double saturation_dn = 0;  // grey value at which the camera saturates
  std::vector<NoiseBin> bins;
  int64_t samples = 0;
  int residual_stacks = 0, repeated_stacks = 0;  // stacks whose residuals, and differences to the previous, were used
  double nonlinearity = 0;  // root mean square relative deviation of the bins' variances from the line
  double flicker = 0;       // standard deviation of the images' relative brightness
  double harmonics = 0;     // largest amplitude of a waveform's harmonic relative to its modulation
  double correlation = 0;   // of the residuals between neighbouring pixels; white noise has 0
};

// Returns the number of noise samples that one stack of these patterns yields per pixel: 0 if a measurement requires
// repeated stacks.
int noise_samples_per_pixel(const PatternSequence& sequence);

// Collects noise samples from stacks.
class NoiseEstimator {
 public:
  // `prior` supplies the bit depth and all parameters that images cannot show. Throws Error if options are out of range.
  NoiseEstimator(const SensorModel& prior, const NoiseOptions& options);

  // Adds the residuals of a stack, and its differences to the previous stack if nothing moved between the two. Throws Error
  // if its patterns differ in exposure: the model has one mean for all of them.
  void add(const FringeStack& stack);

  // Returns the estimate. Throws Error if there are too few samples or too few grey levels, or if the variance does not
  // grow with the grey value.
  CameraNoise estimate() const;

 private:
  struct Sample {
    float grey_dn, noise_dn, darkest_dn;
    uint8_t block;
  };

  void add_residuals(const FringeStack& stack);
  void add_differences(const FringeStack& stack);

  SensorModel prior_;
  NoiseOptions options_;
  std::vector<Sample> samples_;
  std::vector<cv::Mat> previous_;
  PatternSequence previous_patterns_;
  std::vector<int64_t> histogram_;  // of the grey values, 256 bins over the full scale
  int residual_stacks_ = 0, repeated_stacks_ = 0;
  std::vector<double> flicker_, harmonics_, correlations_;
};

}  // namespace fringeslam
