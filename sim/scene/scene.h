// SPDX-License-Identifier: Apache-2.0
// A described world: objects with materials, light, the rig, where it goes. Read from scene.yaml (keys
// in scenes/README.md); everything random in it is drawn from the seed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"
#include "core/types/trajectory.h"
#include "sim/scene/mesh.h"

namespace fringeslam::sim {

enum class Grain { plain, cardboard, foam, wood, stone, checkerboard, circles, asymmetric_circles };

// Lambertian, with a solid texture: the albedo at a point of the object's own frame.
struct Material {
  Grain grain = Grain::plain;
  double albedo = 0.5;    // mean
  double contrast = 0.3;  // peak deviation from the mean, as a fraction of it
  double grain_m = 0.01;  // size of the largest features
  // Calibration boards, printed on the plane z = 0 about its middle: inner corners or circles, their spacing (of an
  // asymmetric grid within a row), the circles' diameter, and the albedo of the print.
  int columns = 0, rows = 0;
  double spacing_m = 0.01, diameter_m = 0.005, print_albedo = 0.1;

  double albedo_at(const Eigen::Vector3d& point, uint32_t seed) const;
};

struct Object {
  std::string name;  // shape and number, for messages
  Mesh mesh;
  Pose world_from_object;
  Material material;
  uint32_t texture_seed = 0;
};

struct Scene {
  std::string name;
  uint64_t seed = 0;
  std::vector<Object> objects;
  RigModel rig;
  PatternSequence patterns;
  double ambient_electrons = 0;  // from a white surface, in one exposure
  Trajectory trajectory;         // of the robot
  bool commanded = false;        // whether the one who moves the robot knows the trajectory
};

// Throws Error with file:line on anything that is missing, unknown, not finite, out of range or
// impossible. `seed` replaces the file's.
Scene load_scene(const std::filesystem::path& file, std::optional<uint64_t> seed = std::nullopt);

}  // namespace fringeslam::sim
