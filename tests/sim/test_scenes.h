// SPDX-License-Identifier: Apache-2.0
// Small scenes with closed-form solutions, for the simulator tests.
#pragma once

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "sim/light/beam.h"
#include "sim/light/effects.h"
#include "sim/light/photometry.h"
#include "sim/light/renderer.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

constexpr double kPi = std::numbers::pi;

// Returns a diffuse object with uniform albedo.
inline Object grey_object(Mesh mesh, const Pose& world_from_object, double albedo = 0.5) {
  Object object;
  object.mesh = std::make_shared<const Mesh>(std::move(mesh));
  object.world_from_object = world_from_object;
  object.material.albedo = albedo;
  return object;
}

// On-axis illuminance of a white projector image at 1 m, lux, for the rigs below.
constexpr double kWhiteLux = 30000;

inline void set_lux_at_1m(RigModel& rig, double lux) { rig.projector_lens.flux_lm *= lux / projector_lux_at_1m(rig); }

// Returns a rig with coincident camera and projector centres and axes, without distortion.
inline RigModel coaxial_rig() {
  RigModel rig;
  rig.camera = {65, 49, 200, 200, 32, 24, {}};
  rig.projector = {129, 97, 200, 200, 64, 48, {}};
  rig.projector_black_level = 0;
  rig.camera_lens.vignetting = 0;
  set_lux_at_1m(rig, kWhiteLux);
  return rig;
}

// Crops the camera's image to a square of this edge, px, about its centre.
inline void crop(Pinhole& camera, int edge) {
  camera.cx -= 0.5 * (camera.width - edge);
  camera.cy -= 0.5 * (camera.height - edge);
  camera.width = camera.height = edge;
}

inline Scene world_of(std::vector<Object> objects, const RigModel& rig) {
  Scene scene;
  scene.objects = std::move(objects);
  scene.rig = rig;
  scene.trajectory = {TimedPose{}};
  return scene;
}

// Returns the albedo at a point in the object frame.
inline double albedo_at(const Material& material, const Eigen::Vector3d& point, uint32_t seed) {
  NoisePoints points{};
  points.x[0] = static_cast<float>(point.x());
  points.y[0] = static_cast<float>(point.y());
  points.z[0] = static_cast<float>(point.z());
  return static_cast<double>(material.albedo_at(points, seed).value[0]);
}

// All effects are off except this one.
inline Effects only(bool Effects::*effect) {
  Effects effects = Effects::none();
  effects.*effect = true;
  return effects;
}

// Renders the light W, lux, of each pattern for a camera at `pose`.
inline std::vector<cv::Mat1f> lux_of(const Scene& scene, const std::vector<Pattern>& patterns, int samples = 1,
                                     const Effects& effects = Effects::none(), const Pose& pose = {},
                                     TruthFrame* truth = nullptr) {
  const PatternSequence sequence{scene.rig.projector.width, scene.rig.projector.height, patterns};
  const BlurRange blur = Beam::blur_range(scene.rig, effects, 0.3, 5);
  return Renderer(scene, effects, samples).render(ProjectedPatterns(sequence, scene.rig, blur), {pose}, 0, truth);
}

inline TruthFrame truth_of(const Scene& scene, int samples = 1, const Pose& pose = {}) {
  TruthFrame truth;
  lux_of(scene, {}, samples, Effects::none(), pose, &truth);
  return truth;
}

// Returns a pattern of uniform intensity.
inline Pattern constant_pattern(double intensity) {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = intensity;
  pattern.bits = 0;
  return pattern;
}

}  // namespace fringeslam::sim
