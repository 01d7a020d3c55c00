// SPDX-License-Identifier: Apache-2.0
// How far the map lies from the true surfaces that the views saw, as colours of the map.
#pragma once

#include <vector>

#include "core/map/cloud.h"
#include "core/types/frame.h"
#include "core/types/pose.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam::tools {

// Signed distances of points from true surfaces, d = n . (p - x), p the true point and n its normal, towards the
// camera, at the pixel onto which x falls: positive behind the surface, as a depth that is too large. Of all views it
// is the one that sees x nearest and least aslant. Pixels that hold an edge do not count, nor surfaces more than 30 mm
// from x along the ray or turned by more than 45 degrees against its own.
class MapError {
 public:
  MapError(const std::vector<CloudPoint>& points, const RigModel& rig);

  // `map_from_camera`: where the camera truly was, in the map's frame.
  void add(const TruthFrame& truth, const Pose& map_from_camera);

  // m; NaN where no view tells.
  const std::vector<float>& distances_m() const { return distances_m_; }

 private:
  const std::vector<CloudPoint>& points_;
  RigModel rig_;
  PixelRays rays_;
  std::vector<float> distances_m_, weights_;
};

}  // namespace fringeslam::tools
