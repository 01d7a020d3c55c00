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

// Blur would mark all pixels of narrow faces as mixed, although most of them still show their face.
Effects sampled_effects() {
  Effects effects = reduced_effects();
  effects.lens_blur = false;
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

bool has_indirect_light(const Scene& scene) {
  return scene.bounces > 0 || std::any_of(scene.objects.begin(), scene.objects.end(), [](const Object& object) {
           return object.material.mean_free_path_m > 0 || object.material.pane;
         });
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
      sampled_(full_, reduced_scene_, sampled_effects(), kSamples, 1.0 / kReduction),
      full_camera_(scene.rig, {}, scene.seed, full_.rays().blur_px),
      reduced_camera_(reduced_scene_.rig, reduced_effects(), scene.seed, reduced_.rays().blur_px) {}

cv::Mat SensorView::image(const Pose& world_from_robot, std::optional<size_t> pattern, bool reduced, const Stop& stop) {
  const Renderer& renderer = reduced ? reduced_ : full_;
  const Camera& camera = reduced ? reduced_camera_ : full_camera_;
  const RigModel& rig = scene_.rig;
  const std::shared_ptr<const ProjectedPatterns> light = shown(pattern);
  const std::vector<cv::Mat1f> lux =
      renderer.render(*light, {world_from_robot * rig.robot_from_camera}, 0, nullptr, stop);
  if (lux.empty()) return {};
  // White stands for the brightest image of a stack.
  const double factor = pattern ? scene_.patterns.patterns[*pattern].exposure : 1;
  return camera.expose(camera.electrons_per_s(lux.front()), factor * exposure_s(camera, lux.back()),
                       {.noise = !reduced, .seed = scene_.seed, .image = static_cast<int>(pattern.value_or(0))});
}

double SensorView::exposure_s(const Camera& camera, const cv::Mat1f& brightest) const {
  const Timing& timing = scene_.rig.timing;
  if (!scene_.auto_exposure) return timing.exposure_s;
  double longest = 1;
  for (const Pattern& each : scene_.patterns.patterns) longest = std::max(longest, each.exposure);
  return camera.auto_exposure_s(camera.electrons_per_s(brightest), 1 / (longest * timing.pattern_rate_hz));
}

std::optional<SensorView::Stack> SensorView::stack(const TimedPose& pose, const Stop& stop) {
  std::shared_ptr<const ProjectedPatterns> light;
  {
    const std::lock_guard lock(mutex_);
    if (!all_shown_)
      all_shown_ = std::make_shared<const ProjectedPatterns>(scene_.patterns, scene_.rig, blur_range(scene_.rig, {}));
    light = all_shown_;
  }
  Stack result;
  const std::vector<cv::Mat1f> lux =
      sampled_.render(*light, {pose.world_from_robot * scene_.rig.robot_from_camera}, 0, &result.truth, stop);
  if (lux.empty()) return std::nullopt;
  result.truth.timestamp_s = pose.timestamp_s;
  result.truth.world_from_robot = pose.world_from_robot;
  cv::Mat1f brightest = lux.front().clone();
  for (const cv::Mat1f& image : lux) brightest = cv::max(brightest, image);
  const double exposure = exposure_s(reduced_camera_, brightest);
  FringeStack& stack = result.stack;
  stack.timestamp_s = pose.timestamp_s;
  stack.patterns = scene_.patterns;
  stack.exposure_time_s = exposure_times_s(pose.timestamp_s, scene_.patterns, scene_.rig.timing);
  for (size_t i = 0; i < lux.size(); ++i) {
    stack.exposure_s.push_back(scene_.patterns.patterns[i].exposure * exposure);
    stack.images.push_back(reduced_camera_.expose(reduced_camera_.electrons_per_s(lux[i]), stack.exposure_s.back(),
                                                  {.noise = false, .seed = scene_.seed, .image = static_cast<int>(i)}));
  }
  return result;
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

cv::Mat1f SensorView::indirect_share(const Pose& world_from_robot, bool reduced, const Stop& stop) {
  TruthFrame truth;
  (reduced ? reduced_ : full_)
      .render(*shown(std::nullopt), {world_from_robot * scene_.rig.robot_from_camera}, 0, &truth, stop);
  return truth.indirect_share;
}

std::shared_ptr<const ProjectedPatterns> SensorView::shown(std::optional<size_t> pattern) {
  const std::lock_guard lock(mutex_);
  if (const auto known = shown_.find(pattern); known != shown_.end()) return known->second;
  PatternSequence sequence = scene_.patterns;
  sequence.patterns = {white_pattern()};
  if (pattern) sequence.patterns.insert(sequence.patterns.begin(), scene_.patterns.patterns.at(*pattern));
  auto light = std::make_shared<const ProjectedPatterns>(sequence, scene_.rig, blur_range(scene_.rig, {}));
  // White is shown again and again.
  if (pattern) std::erase_if(shown_, [](const auto& entry) { return entry.first.has_value(); });
  shown_.emplace(pattern, light);
  return light;
}

}  // namespace fringeslam::sim
