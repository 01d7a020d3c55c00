// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/thermal_observer.h"

#include "core/base/stage_clock.h"
#include "core/thermal/registration.h"

namespace fringeslam {

ThermalObserver::ThermalObserver(const RigModel& rig, const ThermalOptions& options) : rig_(rig), options_(options) {
  check_options(options, "thermal");
}

ThermalView ThermalObserver::observe(const FringeStack& stack, const FrameResult& result) {
  ThermalView view;
  if (stack.thermal_c.empty()) return view;
  enter_stage("thermal");
  const RegisteredThermal thermal = register_thermal(result.frame.points_m, stack.thermal_c, rig_, options_);
  view.temperature_c = thermal.temperature_c;
  view.warm = find_warm_regions(result.frame, thermal, rig_, options_);
  view.landmarks = landmark_temperatures(thermal.temperature_c, view.warm, result.landmarks, options_);
  const bool keep = result.in_map || (result.tracking != Tracking::followed && has_pose(result.tracking));
  if (keep && !view.warm.list.empty()) seen_[result.view] = {stack.index, {}, view.warm.list};
  return view;
}

std::vector<WarmObject> ThermalObserver::warm_objects(const Mapper& mapper) const {
  std::vector<LocatedRegions> views;
  for (const auto& [view, regions] : seen_) {
    views.push_back(regions);
    views.back().world_from_camera = mapper.world_from_frame(view);
  }
  return merge_regions(views, options_);
}

}  // namespace fringeslam
