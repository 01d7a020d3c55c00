// SPDX-License-Identifier: Apache-2.0
// Benchmark reference for the renderer: traces only the camera and shadow rays of one view with Embree, in the same
// packets and order and on the same threads as the renderer.
#pragma once

#include <memory>

#include "sim/light/renderer.h"

namespace fringeslam::sim {

class RayTracingBaseline {
 public:
  // Prepares the rays of the trajectory's first pose. The renderer must outlive this object.
  RayTracingBaseline(const Scene& scene, const Renderer& renderer);
  ~RayTracingBaseline();

  // Returns the number of rays, camera and shadow rays together.
  size_t count() const;
  // Traces all rays and discards the results.
  void operator()() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
