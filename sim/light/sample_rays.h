// SPDX-License-Identifier: Apache-2.0
// Sample positions within a pixel and in the lens pupil.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/types/pinhole.h"

namespace fringeslam::sim {

// Undistorted viewing rays (x, y, 1) of all samples of all pixels, camera frame; computed once per rig.
struct SampleRays {
  int per_pixel = 1;
  double extent = 1;                     // edge of the square over which a pixel's samples are spread, px
  std::vector<Eigen::Vector2d> samples;  // pixel-major
  std::vector<Eigen::Vector2d> centres;
  std::vector<Eigen::Vector2d> pupil;  // origin of each sample; the unit pupil, but for few points just outside
};

// Computes the rays of `per_pixel` samples (a square number) whose mean position is the pixel centre.
SampleRays sample_rays(const Pinhole& camera, int per_pixel, double extent = 1);

}  // namespace fringeslam::sim
