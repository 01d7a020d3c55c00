// SPDX-License-Identifier: Apache-2.0
// Distance of the map from the true surfaces seen by the views, as colours of the map.
#pragma once

#include <vector>

#include "core/map/cloud.h"
#include "core/types/frame.h"
#include "core/types/pose.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam::tools {

// Signed distances of points from the true surfaces, d = n . (p - x), where p is the true point and n its normal
// (towards the camera) at the pixel onto which x projects: positive behind the surface, like a depth that is too large.
// Of all views the one that sees x closest and least obliquely counts. Pixels on an edge are ignored, and so are
// surfaces more than 30 mm from x along the ray or tilted by more than 45 degrees against its normal.
class MapError {
 public:
  MapError(const std::vector<CloudPoint>& points, const RigModel& rig);

  // Adds a view. `map_from_camera` is the camera's true pose in the map's frame.
  void add(const TruthFrame& truth, const Pose& map_from_camera);

  // m; NaN for points seen by no view.
  const std::vector<float>& distances_m() const { return distances_m_; }

 private:
  const std::vector<CloudPoint>& points_;
  RigModel rig_;
  PixelRays rays_;
  std::vector<float> distances_m_, weights_;
};

}  // namespace fringeslam::tools
