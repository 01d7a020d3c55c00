// SPDX-License-Identifier: Apache-2.0
// Pictures of what a scene's camera sees, as PNG for the scene's page.
#pragma once

#include <optional>
#include <string>

#include "core/types/options.h"
#include "sim/sensor_view.h"

namespace fringeslam::tools {

enum class SensorPicture { texture, pattern, depth, mask };

constexpr auto choices(SensorPicture) {
  using enum SensorPicture;
  return std::to_array<Choice<SensorPicture>>(
      {{texture, "texture"}, {pattern, "pattern"}, {depth, "depth"}, {mask, "mask"}});
}

// Levels of the mask; 0: no surface.
constexpr uchar kLitLevel = 1, kShadowLevel = 128, kOutOfBeamLevel = 255;

// Renders a picture from a robot pose. `pattern` is the number of the pattern shown. Texture and pattern: grey values, full
// scale 255. Depth: levels() between near_m and far_m of `rig`. Returns an empty string if `stop` returned true meanwhile.
std::string sensor_picture(sim::SensorView& view, const RigModel& rig, SensorPicture kind, size_t pattern,
                           const Pose& world_from_robot, bool reduced, const sim::Stop& stop);

}  // namespace fringeslam::tools
