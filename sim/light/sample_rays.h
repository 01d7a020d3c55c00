// SPDX-License-Identifier: Apache-2.0
// Where the rays of a pixel go through it, and where in the lens' pupil they start.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/types/pinhole.h"

namespace fringeslam::sim {

// Undistorted viewing rays of all samples of all pixels, camera frame, as (x, y) with z = 1; computed once a rig.
struct SampleRays {
  int per_pixel = 1;
  std::vector<Eigen::Vector2d> samples;  // pixel-major
  std::vector<Eigen::Vector2d> centres;
  std::vector<Eigen::Vector2d> pupil;  // start of each sample in the unit pupil
};

// A square number of samples; their mean is the pixel's centre.
SampleRays sample_rays(const Pinhole& camera, int per_pixel);

}  // namespace fringeslam::sim
