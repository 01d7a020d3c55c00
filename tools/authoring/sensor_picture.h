// SPDX-License-Identifier: Apache-2.0
// Pictures of what a scene's camera sees, as PNG for the scene's page.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/types/options.h"
#include "sim/sensor_view.h"

namespace fringeslam::tools {

enum class SensorPicture { texture, pattern, depth, mask, wrong_order, indirect, temperature };

constexpr auto choices(SensorPicture) {
  using enum SensorPicture;
  return std::to_array<Choice<SensorPicture>>({{texture, "texture"},
                                               {pattern, "pattern"},
                                               {depth, "depth"},
                                               {mask, "mask"},
                                               {wrong_order, "wrong_order"},
                                               {indirect, "indirect"},
                                               {temperature, "temperature"}});
}

// Levels of the mask; 0: no surface.
constexpr uchar kLitLevel = 1, kShadowLevel = 128, kOutOfBeamLevel = 255;

// Range of the probability of a wrong fringe order that is shown, as powers of ten.
constexpr double kLeastWrongOrder = -6, kMostWrongOrder = 0;

// The pictures that show anything of a scene.
std::vector<SensorPicture> pictures_of(const sim::Scene& scene);

// Coldest and warmest surface, at least 1 K apart.
std::pair<double, double> temperature_range_c(const sim::Scene& scene);

// Renders a picture from a robot pose. `pattern` is the number of the pattern shown. Texture and pattern: grey values, full
// scale 255. The others are levels(): depth between near_m and far_m of the rig; the share of indirect light between 0 and 1;
// temperature in its range. The probability of a wrong fringe order is that of a stack without noise, whose sensor noise is
// known, and 1 where its order is wrong even so: logarithmic, always reduced. Returns an empty string if `stop` returned true meanwhile. Throws Error if the scene's
// patterns cannot be decoded.
std::string sensor_picture(sim::SensorView& view, const sim::Scene& scene, SensorPicture kind, size_t pattern,
                           const Pose& world_from_robot, bool reduced, const sim::Stop& stop);

}  // namespace fringeslam::tools
