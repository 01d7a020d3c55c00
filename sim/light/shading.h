// SPDX-License-Identifier: Apache-2.0
// Light: geometry is traced once a pose into samples, and every pattern is shaded from the samples.
//
// A sample's surface point, at distance r from the projector and lit under the angle theta, sends to the
// camera   e = albedo (E_white cos(theta) / r^2 * beam(u, v) + E_ambient)   electrons in one exposure, with
// beam(u, v) = black + (1 - black) * pattern and 0 in shadow or out of the beam. A pixel is the mean of
// its samples.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"
#include "sim/light/ray_world.h"

namespace fringeslam::sim {

// What a camera sample sees, all that shading needs of it.
struct Sample {
  float ambient = 0;          // albedo; 0 where nothing is seen
  float beam = 0;             // albedo cos(theta) / r^2 (m^-2); 0 in shadow or out of the beam
  float column = 0, row = 0;  // projector coordinates, px
};

// Undistorted viewing rays of all samples of all pixels, camera frame, d_z = 1; computed once a rig.
struct SampleRays {
  int per_pixel = 1;
  std::vector<Eigen::Vector3d> samples;  // pixel-major
  std::vector<Eigen::Vector3d> centres;
};

// 1, 4 (rotated grid) or any square number of samples; their mean is the pixel's centre.
SampleRays sample_rays(const Pinhole& camera, int per_pixel);

struct TracedView {
  std::vector<Sample> samples;
  TruthFrame truth;
};

TracedView trace_view(const RayWorld& world, const RigModel& rig, const SampleRays& rays,
                      const Pose& world_from_camera);

// Expected electrons of every pixel under one pattern of a sequence, through the projector's response: H x W.
cv::Mat1f shade(const TracedView& view, int samples_per_pixel, const Pattern& pattern, const PatternSequence& sequence,
                const RigModel& rig, double ambient_electrons);

// The camera: electrons -> grey values. With noise: shot and dark noise as one normal deviate of
// variance n + sigma_d^2 at the address (seed, stack, image, pixel). Quantised: CV_8U or CV_16U by the
// sensor's bits; else CV_32F grey values, which neither clip nor round.
struct Exposure {
  bool noise = true, quantise = true;
  uint64_t seed = 0;
  int stack = 0, image = 0;
};
cv::Mat expose(const cv::Mat1f& electrons, const SensorModel& sensor, const Exposure& exposure);

}  // namespace fringeslam::sim
