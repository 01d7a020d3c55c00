// SPDX-License-Identifier: Apache-2.0
#include "tools/report/effects.h"

#include <cmath>
#include <optional>

#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace {

// Collects the effects by option name.
struct Names {
  std::vector<std::pair<std::string, bool*>> effects;
  void field(const char* name, bool& value, const char*) { effects.emplace_back(name, &value); }
  void field(const char*, int&, Range, const char*) {}
};

// Returns the index of the finest fringe pattern with the smallest phase shift.
size_t finest(const PatternSequence& sequence) {
  std::optional<size_t> best;
  const auto key = [](const Pattern& p) { return std::pair(p.period_px, std::abs(p.shift_rad)); };
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::fringe) continue;
    if (!best || key(pattern) < key(sequence.patterns[*best])) best = i;
  }
  if (!best) throw Error("the scene's patterns contain no fringes");
  return *best;
}

cv::Mat3b shot(const sim::Scene& scene, const sim::RenderOptions& options) {
  const std::optional<FringeStack> stack = sim::VirtualRig(scene, options).capture(scene.patterns);
  if (!stack)
    throw Error("trajectory.continuous: the path is shorter than one stack of " +
                std::to_string(scene.patterns.patterns.size()) +
                " images; use a longer route, a lower speed_m_s or fewer patterns");
  return grey_picture(stack->images[finest(scene.patterns)], scene.rig.sensor.max_dn());
}

}  // namespace

cv::Mat3b effects_picture(const sim::Scene& scene, const sim::RenderOptions& options) {
  constexpr size_t kColumns = 5;
  sim::RenderOptions shown = options;
  Names names;
  shown.effects.describe(names);
  for (const auto& [name, on] : names.effects) *on = false;
  std::vector<std::vector<Panel>> rows(1);
  const auto add = [&](const std::string& title) {
    if (rows.back().size() == kColumns) rows.emplace_back();
    rows.back().push_back({title, shot(scene, shown)});
  };
  add("no effect");
  for (const auto& [name, on] : names.effects) {
    *on = true;
    add(name);
    *on = false;
  }
  for (const auto& [name, on] : names.effects) *on = true;
  add("all");
  return sheet(rows, {384, 360});
}

}  // namespace fringeslam::tools
