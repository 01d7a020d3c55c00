// SPDX-License-Identifier: Apache-2.0
// The camera by EMVA 1288: light in lux (W = pi L, sim/light/photometry.h) to grey values. A pixel with the response
// 1 + prnu and the dark offset dsnu collects in the exposure t
//
//   n = eta (1 + prnu) photons + dark_current t + dsnu       electrons, mean
//
// Shot and dark noise are one normal deviate of variance n + sigma_d^2, the full well cuts off, and
// y = offset + K n is rounded to the sensor's bits and clipped.
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
  // `seed` picks the specimen: its pixels' nonuniformities.
  Camera(const RigModel& rig, const Effects& effects, uint64_t seed);

  // Mean electrons that one second of such light gives: the lens' blur and vignetting, the pixels' responses.
  cv::Mat1f electrons_per_s(const cv::Mat1f& lux) const;

  // Quantised: CV_8U or CV_16U by the sensor's bits; else CV_32F grey values, which neither clip nor round.
  cv::Mat expose(const cv::Mat1f& electrons_per_s, double exposure_s, const Exposure& exposure) const;

  // The exposure under which all but one pixel in a thousand of the brightest image stay below 80 % of saturation; no
  // longer than `longest_s`.
  double auto_exposure_s(const cv::Mat1f& brightest_electrons_per_s, double longest_s) const;

 private:
  SensorModel sensor_;
  double blur_px_ = 0;
  cv::Mat1f response_;        // electrons/(lux s) of each pixel
  cv::Mat1f dark_electrons_;  // DSNU; empty: none
};

}  // namespace fringeslam::sim
