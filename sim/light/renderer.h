// SPDX-License-Identifier: Apache-2.0
// Light on its way from the projector to the camera. Geometry is traced once a pose, and each lit point that a pixel
// sees, directly, over other surfaces, or in hazy air, adds to the light of all patterns at once.
//
// A pixel under a pattern is the mean over its samples of
//
//   W = sum_points w beam(u, v) + rho E_ambient + M       lux (sim/light/photometry.h)
//
// with w = pi f_r E cos(i) for a surface (sim/light/beam.h, gloss.h), and a path's weights in front of it when the
// light comes over other surfaces. In air of extinction s all of it is weakened by exp(-s (r + r')) along camera ray
// and projector ray, and the beam scatters back: W_air = pi a s p(theta) E exp(-s (r + r')) for each metre of the ray.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/truth.h"
#include "sim/light/effects.h"
#include "sim/light/ray_world.h"
#include "sim/light/sample_rays.h"
#include "sim/light/shown_patterns.h"
#include "sim/light/surfaces.h"

namespace fringeslam::sim {

class Renderer {
 public:
  Renderer(const Scene& scene, const Effects& effects, int samples_per_pixel);

  // W of every pixel under each pattern, in the order of the sequence; H x W. Several poses are those of the camera at
  // equal parts of the exposure. `truth`, when asked for, is that of the first pose (pose, time and orders are left
  // alone). `stack` keeps the random paths of different stacks apart.
  std::vector<cv::Mat1f> render(const ShownPatterns& patterns, const std::vector<Pose>& world_from_camera, int stack,
                                TruthFrame* truth = nullptr) const;

  const RayWorld& world() const { return world_; }
  const Surfaces& surfaces() const { return surfaces_; }
  const SampleRays& rays() const { return rays_; }

 private:
  friend class BlockRenderer;
  const Scene& scene_;
  Effects effects_;
  RayWorld world_;
  Surfaces surfaces_;
  SampleRays rays_;
};

}  // namespace fringeslam::sim
