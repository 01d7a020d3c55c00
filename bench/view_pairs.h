// SPDX-License-Identifier: Apache-2.0
// Views of a generated scene as processed by the pipeline, with ground truth.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/types/frame.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam::sim {
struct Scene;
}

namespace fringeslam::bench {

struct View {
  Frame frame;
  TruthFrame truth;
};

struct Views {
  RigModel rig;
  PixelRays rays;
  std::vector<View> views;

  Pose world_from_camera(size_t view) const { return views[view].truth.world_from_robot * rig.robot_from_camera; }
};
using ViewPair = Views;  // exactly two

// Views from the given camera poses.
Views rendered_views(const std::string& scene_name, uint64_t seed, const std::vector<Pose>& world_from_camera);
Views rendered_views(sim::Scene scene, const std::vector<Pose>& world_from_camera);

// The first two views of the scene's trajectory, or the first one and one with the camera at `first_from_second`.
ViewPair rendered_pair(const std::string& scene_name, uint64_t seed,
                       const std::optional<Pose>& first_from_second = std::nullopt);

}  // namespace fringeslam::bench
