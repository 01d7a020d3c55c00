// SPDX-License-Identifier: Apache-2.0
// EMVA 1288 camera model: converts light W = pi L in lux (sim/light/photometry.h) to grey values (docs/method.md,
// section 12.2). During an exposure t, a pixel with relative response 1 + prnu and dark offset dsnu collects
//
//   n = eta (1 + prnu) photons + dark_current t + dsnu       electrons, mean
//
// Shot and dark noise are drawn as one normal deviate of variance n + sigma_d^2. The charge is limited to the full
// well, and y = offset + K n is rounded to the sensor's bit depth and clipped.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "core/types/rig_model.h"
#include "sim/light/effects.h"

namespace fringeslam::sim {

struct Exposure {
  bool noise = true, quantise = true;
  uint64_t seed = 0;
  int stack = 0, image = 0;
};

class Camera {
 public:
  // `seed` selects the sensor specimen, that is, the fixed pattern of PRNU and DSNU. `sampled_blur_px` is the part of the lens
  // blur that the light already contains (SampleRays::blur_px), as it contains the vignetting within a pixel.
  Camera(const RigModel& rig, const Effects& effects, uint64_t seed, double sampled_blur_px);

  // Converts light, lux, to mean electrons per second, with the rest of the lens blur, vignetting and pixel response.
  cv::Mat1f electrons_per_s(const cv::Mat1f& lux) const;

  // Exposes an image. Quantised: CV_8U or CV_16U, by bit depth; otherwise CV_32F grey values, not clipped or rounded.
  cv::Mat expose(const cv::Mat1f& electrons_per_s, double exposure_s, const Exposure& exposure) const;

  // Returns the exposure at which 99.9 % of the brightest image's pixels stay below 80 % of saturation, limited to
  // `longest_s`.
  double auto_exposure_s(const cv::Mat1f& brightest_electrons_per_s, double longest_s) const;

 private:
  SensorModel sensor_;
  double blur_px_ = 0;
  cv::Mat1f vignetting_;      // relative to the axis; empty: 1, or contained in the response
  cv::Mat1f response_;        // electrons/(lux s), per pixel
  cv::Mat1f dark_electrons_;  // DSNU; empty if there is none
};

}  // namespace fringeslam::sim
