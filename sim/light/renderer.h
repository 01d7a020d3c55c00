// SPDX-License-Identifier: Apache-2.0
// Renderer: light transport from the projector to the camera (docs/method.md, section 12.1). Rays are traced once per
// pose; each lit point seen by a pixel, directly, via other surfaces or in hazy air, contributes to the images of all
// patterns in one step.
//
// A pixel's value under a pattern is the mean over its samples of
//
//   W = sum_points w beam(u, v) + rho E_ambient + M       lux (sim/light/photometry.h)
//
// where w = pi f_r E cos(i) at a surface (sim/light/beam.h, gloss.h), multiplied by the path's weights for indirect
// light, and M is the emission. Air with extinction s attenuates this by exp(-s (r + r')) along camera ray and
// projector ray, and scatters light of the beam into the camera: W_air = pi a s p(theta) E exp(-s (r + r')) per metre
// of the camera ray.
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/truth.h"
#include "sim/light/effects.h"
#include "sim/light/panes.h"
#include "sim/light/projected_patterns.h"
#include "sim/light/ray_scene.h"
#include "sim/light/sample_rays.h"
#include "sim/light/surfaces.h"

namespace fringeslam::sim {

// Returns true to stop a rendering. Called by several threads concurrently.
using Stop = std::function<bool()>;

class Renderer {
 public:
  Renderer(const Scene& scene, const Effects& effects, int samples_per_pixel);
  // Shares the objects of `other`, whose scene must have the same objects, materials and dust; camera, projector and
  // light may differ. `effects` must agree with those of `other` in gloss, panes, relief, dust and subsurface. Pixels see only the middle
  // square of edge `extent` px.
  Renderer(const Renderer& other, const Scene& scene, const Effects& effects, int samples_per_pixel, double extent = 1);

  // Renders W, lux, under each pattern, in sequence order; H x W. Several poses divide the exposure into equal parts.
  // `truth`, if given, receives the ground truth of the first pose, except index, time, pose and fringe orders. `stack`
  // keys the random paths. `stop`, if given, is called before each row of blocks; once it has returned true, the result
  // is empty, and so is `truth`.
  std::vector<cv::Mat1f> render(const ProjectedPatterns& patterns, const std::vector<Pose>& world_from_camera,
                                int stack, TruthFrame* truth = nullptr, const Stop& stop = nullptr) const;

  const RayScene& world() const { return *world_; }
  const Surfaces& surfaces() const { return *surfaces_; }
  const SampleRays& rays() const { return *rays_; }

 private:
  friend class BlockRenderer;
  const Scene& scene_;
  Effects effects_;
  std::shared_ptr<const RayScene> world_;
  std::shared_ptr<const Surfaces> surfaces_;
  std::shared_ptr<const Panes> panes_;  // null: none
  std::shared_ptr<const SampleRays> rays_;
};

}  // namespace fringeslam::sim
