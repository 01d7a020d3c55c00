// SPDX-License-Identifier: Apache-2.0
#include "sim/sensor_view.h"

#include <algorithm>
#include <cmath>

#include "sim/virtual_rig.h"

namespace fringeslam::sim {

namespace {

constexpr int kSamples = 4;  // per pixel, as by default in RenderOptions

Effects reduced_effects() {
  Effects effects;
  effects.bounce_paths = kSamples;
  effects.fixed_pattern = false;
  return effects;
}

Scene reduced(Scene scene) {
  const auto part = [](int length) { return std::max(1, length / SensorView::kReduction); };
  scene.rig = with_camera_size(scene.rig, {part(scene.rig.camera.width), part(scene.rig.camera.height)});
  return scene;
}

}  // namespace

RigModel with_camera_size(const RigModel& rig, const cv::Size& size) {
  RigModel result = rig;
  Pinhole& camera = result.camera;
  const double sx = static_cast<double>(size.width) / camera.width,
               sy = static_cast<double>(size.height) / camera.height;
  camera.width = size.width, camera.height = size.height;
  camera.fx *= sx, camera.fy *= sy;
  camera.cx = sx * (camera.cx + 0.5) - 0.5, camera.cy = sy * (camera.cy + 0.5) - 0.5;
  // The same focal length and pupil; larger pixels would collect more light.
  CameraLens& lens = result.camera_lens;
  lens.pixel_m /= sx;
  lens.transmission *= sx * sy;
  lens.blur_px *= std::sqrt(sx * sy);
  return result;
}

Pattern white_pattern() {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = 1;
  pattern.bits = 0;
  return pattern;
}

SensorView::SensorView(const Scene& scene)
    : scene_(scene),
      reduced_scene_(reduced(scene)),
      full_(scene, {}, kSamples),
      reduced_(full_, reduced_scene_, reduced_effects(), kSamples),
      full_camera_(scene.rig, {}, scene.seed),
      reduced_camera_(reduced_scene_.rig, reduced_effects(), scene.seed) {}

cv::Mat SensorView::image(const Pose& world_from_robot, std::optional<size_t> pattern, bool reduced, const Stop& stop) {
  const Renderer& renderer = reduced ? reduced_ : full_;
  const Camera& camera = reduced ? reduced_camera_ : full_camera_;
  const RigModel& rig = scene_.rig;
  const std::shared_ptr<const ProjectedPatterns> light = shown(pattern);
  const std::vector<cv::Mat1f> lux =
      renderer.render(*light, {world_from_robot * rig.robot_from_camera}, 0, nullptr, stop);
  if (lux.empty()) return {};
  double exposure_s = rig.timing.exposure_s;
  if (scene_.auto_exposure) {
    double longest = 1;
    for (const Pattern& each : scene_.patterns.patterns) longest = std::max(longest, each.exposure);
    // White stands for the brightest image of a stack.
    exposure_s = camera.auto_exposure_s(camera.electrons_per_s(lux.back()), 1 / (longest * rig.timing.pattern_rate_hz));
  }
  if (pattern) exposure_s *= scene_.patterns.patterns[*pattern].exposure;
  return camera.expose(camera.electrons_per_s(lux.front()), exposure_s,
                       {.noise = !reduced, .seed = scene_.seed, .image = static_cast<int>(pattern.value_or(0))});
}

TruthFrame SensorView::truth(const Pose& world_from_robot, bool reduced, const Stop& stop) const {
  const Renderer& renderer = reduced ? reduced_ : full_;
  PatternSequence nothing = scene_.patterns;
  nothing.patterns.clear();
  TruthFrame truth;
  renderer.render(ProjectedPatterns(nothing, scene_.rig, {}), {world_from_robot * scene_.rig.robot_from_camera}, 0,
                  &truth, stop);
  truth.world_from_robot = world_from_robot;
  return truth;
}

std::shared_ptr<const ProjectedPatterns> SensorView::shown(std::optional<size_t> pattern) {
  const std::lock_guard lock(mutex_);
  if (shown_ && shown_->first == pattern) return shown_->second;
  PatternSequence sequence = scene_.patterns;
  sequence.patterns = {white_pattern()};
  if (pattern) sequence.patterns.insert(sequence.patterns.begin(), scene_.patterns.patterns.at(*pattern));
  auto light = std::make_shared<const ProjectedPatterns>(sequence, scene_.rig, blur_range(scene_.rig, {}));
  shown_.emplace(pattern, light);
  return light;
}

}  // namespace fringeslam::sim
