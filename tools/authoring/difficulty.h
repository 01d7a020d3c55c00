// SPDX-License-Identifier: Apache-2.0
// How difficult the views of a scene are for the mapper, from ground truth alone: what each view sees, the depth sigma to
// be expected, the Cramer-Rao bound of the motion since the view before, repetitive structure, and speed.
//
// Each view is rendered reduced (SensorView::stack()), without noise and at rest. Depth, normals and poses are ground truth;
// validity and sigma of the pixels are those that the decoder predicts from the images. Sums over pixels are scaled to the
// number of pixels of the full images.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/types/options.h"
#include "sim/sensor_view.h"

namespace fringeslam::tools {

enum class Hardship { range, depth, overlap, motion, repetition, speed };

constexpr auto choices(Hardship) {
  using enum Hardship;
  return std::to_array<Choice<Hardship>>({{range, "range"},
                                          {depth, "depth"},
                                          {overlap, "overlap"},
                                          {motion, "motion"},
                                          {repetition, "repetition"},
                                          {speed, "speed"}});
}
constexpr size_t kHardships = choices(Hardship()).size();

// Limits beyond which a view is expected to fail.
struct DifficultyLimits {
  double least_in_range = 0.3;  // share of the pixels; as in sim/scene_check.cpp
  double least_measured = 0.15;
  double least_overlap = 0.3;
  // Between consecutive images: that of rubble_pile at 0.6 m/s and 40 deg/s, up to which the motion during a stack was
  // estimated reliably (docs/method.md, section 9.3).
  double most_step_px = 30;
};

struct ViewDifficulty {
  size_t view = 0;  // number in the order of time
  double time_s = 0;
  // Shares of the pixels.
  double lit = 0, near = 0, far = 0,
         in_range = 0;            // lit; of these, nearer than near_m, farther than far_m, and between
  double measured = 0;            // with a depth
  std::optional<double> sigma_m;  // median of the expected depth sigmas
  // With respect to the view before; empty for the first view.
  std::optional<double> overlap;         // share of the points measured that the view before measured, too
  std::optional<double> displacement_m;  // sigma of the scene's position in the least determined direction, by depth
                                         // alone; infinite if undetermined
  // Cramer-Rao bound of the robot's motion (previous_from_current), standard deviations; empty if undetermined.
  std::optional<Eigen::Vector3d> translation_m, rotation_rad;
  // Displacement of the nearest motion that explains both views as well; empty if there is none.
  std::optional<double> repeats_m;
  double step_px = 0;  // image motion from one image of the stack to the next, median of the points
  // By Hardship: measure relative to its limit, 1 and more where the view is expected to fail, and why.
  std::array<double, kHardships> strain{};
  std::array<std::string, kHardships> reason;  // empty below the limit

  double worst() const;
};

// Number of views that the rig takes along the scene's trajectory.
size_t view_count(const sim::Scene& scene);

// Number of views that assess_difficulty() assesses.
size_t assessed_views(const sim::Scene& scene, size_t most);

// Assesses at most `most` views, at equal steps in time and the first included, and passes each to `found`. Views of a
// continuous path are those of complete stacks. Stops when `stop` returns true. Throws Error if the scene's patterns
// cannot be decoded.
void assess_difficulty(const sim::Scene& scene, sim::SensorView& view, size_t most,
                       const std::function<void(ViewDifficulty)>& found, const sim::Stop& stop = nullptr);

}  // namespace fringeslam::tools
