// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/difficulty_json.h"

#include <cmath>

namespace fringeslam::tools {

namespace {

using Json = nlohmann::ordered_json;

Json number(std::optional<double> value) { return value && std::isfinite(*value) ? Json(*value) : Json(); }

Json numbers(const std::optional<Eigen::Vector3d>& values) {
  return values ? Json{values->x(), values->y(), values->z()} : Json();
}

}  // namespace

Json difficulty_json(const ViewDifficulty& view) {
  Json strain = Json::object(), reasons = Json::object();
  for (const auto& [which, name] : choices(Hardship())) {
    const auto i = static_cast<size_t>(which);
    strain[name] = number(view.strain[i]);
    if (!view.reason[i].empty()) reasons[name] = view.reason[i];
  }
  return {{"view", view.view},
          {"time_s", view.time_s},
          {"lit", view.lit},
          {"near", view.near},
          {"far", view.far},
          {"in_range", view.in_range},
          {"measured", view.measured},
          {"sigma_m", number(view.sigma_m)},
          {"overlap", number(view.overlap)},
          {"displacement_m", number(view.displacement_m)},
          {"translation_m", numbers(view.translation_m)},
          {"rotation_rad", numbers(view.rotation_rad)},
          {"repeats_m", number(view.repeats_m)},
          {"step_px", view.step_px},
          {"strain", strain},
          {"reasons", reasons}};
}

}  // namespace fringeslam::tools
