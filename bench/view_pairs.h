// SPDX-License-Identifier: Apache-2.0
// Two views of a generated scene as the pipeline sees them, with their truth.
#pragma once

#include <optional>
#include <string>

#include "core/types/frame.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam::bench {

struct View {
  Frame frame;
  TruthFrame truth;
};

struct ViewPair {
  RigModel rig;
  PixelRays rays;
  View views[2];
};

// The first two views of the scene's trajectory; or the first, and one from where `first_from_second` puts the camera.
ViewPair rendered_pair(const std::string& scene_name, uint64_t seed,
                       const std::optional<Pose>& first_from_second = std::nullopt);

}  // namespace fringeslam::bench
