// SPDX-License-Identifier: Apache-2.0
// Small worlds with closed forms, for the tests of the simulator.
#pragma once

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

constexpr double kPi = std::numbers::pi;

// A matt grey object: every point has the same albedo.
inline Object grey_object(Mesh mesh, const Pose& world_from_object, double albedo = 0.5) {
  Object object;
  object.mesh = std::move(mesh);
  object.world_from_object = world_from_object;
  object.material = {Grain::plain, albedo, 0, 1};
  return object;
}

// Camera and projector in one place, both without distortion: light falls where the camera looks.
inline RigModel coaxial_rig() {
  RigModel rig;
  rig.camera = {65, 49, 200, 200, 32, 24, {}};
  rig.projector = {129, 97, 200, 200, 64, 48, {}};
  rig.white_electrons_at_1m = 30000;
  rig.projector_black_level = 0;
  return rig;
}

inline Scene world_of(std::vector<Object> objects, const RigModel& rig) {
  Scene scene;
  scene.objects = std::move(objects);
  scene.rig = rig;
  scene.trajectory = {TimedPose{}};
  return scene;
}

// A pattern that shows one intensity everywhere.
inline Pattern constant_pattern(double intensity) {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = intensity;
  pattern.bits = 0;
  return pattern;
}

}  // namespace fringeslam::sim
