// SPDX-License-Identifier: Apache-2.0
// The rig in the simulated world: implements Rig, and hands the truth of each view to a sink that the
// pipeline never sees.
#pragma once

#include <functional>

#include "core/rig/rig.h"
#include "core/types/options.h"
#include "sim/light/shading.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

struct RenderOptions {
  int samples_per_pixel = 4;
  bool noise = true;
  bool quantise = true;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("samples_per_pixel", samples_per_pixel, {1, 256}, "rays a pixel: 1, 4 or another square number");
    v.field("noise", noise, "shot and dark noise of the camera");
    v.field("quantise", quantise, "grey values of the camera's bits; off: float images");
  }
  // Throws Error when out of range.
  void check() const;
};

using TruthSink = std::function<void(const TruthFrame&)>;

class VirtualRig : public Rig {
 public:
  VirtualRig(const Scene& scene, const RenderOptions& options, TruthSink truth = {});
  const RigModel& model() const override { return scene_.rig; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

 private:
  const Scene& scene_;
  RenderOptions options_;
  TruthSink truth_;
  RayWorld world_;
  SampleRays rays_;
  size_t next_ = 0;
};

// Writes truth/000000.exr … (core/types/truth.h) into an existing folder.
void write_truth(const TruthFrame& truth, const std::filesystem::path& folder);

}  // namespace fringeslam::sim
