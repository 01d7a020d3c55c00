// SPDX-License-Identifier: Apache-2.0
// Observer of the mapper for rigs with a thermal camera: registers each stack's thermal image with its frame, finds warm
// regions, and merges those of the mapped views into warm objects (docs/method.md, section 10).
#pragma once

#include <map>
#include <vector>

#include "core/mapper/mapper.h"
#include "core/thermal/victims.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

// Empty images without a thermal image.
struct ThermalView {
  cv::Mat1f temperature_c;  // H x W of the frame: apparent temperature; NaN where the thermal camera does not see
  WarmView warm;
  std::vector<LandmarkTemperature> landmarks;  // one for each landmark of the view
};

class ThermalObserver {
 public:
  ThermalObserver(const RigModel& rig, const ThermalOptions& options);
  // Call for each view after it was mapped. Untracked views report warm regions without positions.
  ThermalView observe(const FringeStack& stack, const FrameResult& result);
  // Returns the warm objects at the current poses of the views.
  std::vector<WarmObject> warm_objects(const Mapper& mapper) const;

 private:
  RigModel rig_;
  ThermalOptions options_;
  // By FrameResult::view. The map's views and relocalized ones are enough, and their number is bounded by the map's size.
  std::map<int, LocatedRegions> seen_;
};

}  // namespace fringeslam
