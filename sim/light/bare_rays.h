// SPDX-License-Identifier: Apache-2.0
// The rays of one rendered view and nothing else: what Embree alone takes for them, to compare the renderer with. The
// same rays to surfaces and on to the projector, in the same packets and order, on the same threads.
#pragma once

#include <memory>

#include "sim/light/renderer.h"

namespace fringeslam::sim {

class BareRays {
 public:
  // Of the trajectory's first pose. The renderer must outlive this.
  BareRays(const Scene& scene, const Renderer& renderer);
  ~BareRays();

  size_t count() const;
  void operator()() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
