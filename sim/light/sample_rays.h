// SPDX-License-Identifier: Apache-2.0
// Sample positions within a pixel and its blur, and in the lens pupil.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/types/pinhole.h"

namespace fringeslam::sim {

// Undistorted viewing rays (x, y, 1) of all samples of all pixels, camera frame; computed once per rig.
struct SampleRays {
  int per_pixel = 1;
  double extent = 1;   // edge of a pixel's sensitive square, px
  double blur_px = 0;  // the part of the lens's point spread (standard deviation) that the samples contain
  std::vector<Eigen::Vector2d> samples;  // pixel-major
  std::vector<Eigen::Vector2d> centres;
  std::vector<float> transmission;     // of the lens along each sample's ray, relative to the pixel's center; empty: 1
  std::vector<Eigen::Vector2d> pupil;  // origin of each sample; the unit pupil, but for few points just outside
};

// Computes the rays of `per_pixel` samples (a square number) whose mean position is the pixel centre. They are spread over the
// pixel's square, convolved with a Gaussian of `blur_px` (standard deviation) or as much of it as the samples can represent. An
// image filtered afterwards would mix surfaces too far from their edges, as its pixels have lost the place of the light. The
// lens transmits cos^vignetting of the field angle: within the blur as well, where it moves the light's centroid.
SampleRays sample_rays(const Pinhole& camera, int per_pixel, double extent = 1, double blur_px = 0,
                       double vignetting = 0);

// Returns the share of light that a lens transmits along an undistorted viewing ray (x, y, 1), cos^vignetting of its angle.
double lens_transmission(const Eigen::Vector2d& ray, double vignetting);

// Returns the blur by which an image whose samples contain `sampled_px` must be filtered.
double remaining_blur_px(double blur_px, double sampled_px);

}  // namespace fringeslam::sim
