// SPDX-License-Identifier: Apache-2.0
// A described world: objects with materials, light, the rig, where it goes. Read from scene.yaml (keys
// in scenes/README.md); everything random in it is drawn from the seed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"
#include "core/types/trajectory.h"
#include "sim/scene/material.h"
#include "sim/scene/mesh.h"

namespace fringeslam::sim {

struct Object {
  std::string name;                  // shape and number, for messages
  std::shared_ptr<const Mesh> mesh;  // of several objects perhaps, which is then held once
  Pose world_from_object;
  Material material;
  uint32_t texture_seed = 0;
};

// Homogeneous haze: smoke, or dust in the air.
struct Air {
  double extinction_per_m = 0;  // sigma_t
  double albedo = 0.9;          // share of the extinction that is scattering
  double anisotropy = 0.5;      // mean cosine g of Henyey and Greenstein's phase function
  // Extinction in the long-wave infrared over that of light: small for smoke, whose particles are finer than 1 um.
  double infrared_share = 0.1;
};

// Grey dust that has settled: it covers colour and gloss of what faces upwards.
struct Dust {
  double cover = 0;  // of a horizontal surface, 0 to 1
  double albedo = 0.35;
  double max_slope_deg = 60;  // steeper surfaces stay clean
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  // How far its own temperature has come from that of the surroundings to that of what it lies on.
  double warmed_share = 0.7;
};

// How the robot moves while a stack is taken.
struct Motion {
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();  // of the robot, in its own frame
  Eigen::Vector3d angular_rad_s = Eigen::Vector3d::Zero();
  bool still() const { return velocity_m_s.isZero() && angular_rad_s.isZero(); }
};

// By how much the calibration that the pipeline is given is off the rig that takes the images.
struct CalibrationError {
  Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();  // of the projector, in the camera's frame
  Eigen::Vector3d angles_deg = Eigen::Vector3d::Zero();     // likewise
  double focal = 0;                                         // of the camera, relative
};

struct Scene {
  std::string name;
  uint64_t seed = 0;
  std::vector<Object> objects;
  RigModel rig;
  PatternSequence patterns;
  double ambient_lux = 0;      // even light from all sides
  int bounces = 0;             // of light between surfaces
  bool auto_exposure = false;  // else the rig's
  double surroundings_c = 20;  // of the air, of all around, and of materials that name no temperature
  Air air;
  Dust dust;
  Motion motion;
  CalibrationError calibration_error;
  Trajectory trajectory;                // of the robot
  std::string resolved = {};            // the scene file, with what was drawn in place of distributions
  std::vector<std::string> notes = {};  // what imported files turned out to be, for people
  bool commanded = false;               // whether the one who moves the robot knows the trajectory
};

// What a scene may hold. Files that ask for more would take all of the memory, or days.
struct SceneLimits {
  size_t objects = 100000;
  int scattered = 10000;          // of them by one scatter or pile, whose time grows with the square
  size_t triangles = 30'000'000;  // of all their meshes
  int views = 100000;
};

struct SceneReading {
  std::optional<uint64_t> seed = {};           // replaces the file's
  std::vector<std::string>* errors = nullptr;  // all that is wrong goes there, and the scene is not to be used then
  std::filesystem::path resolved_for = {};     // folder of Scene::resolved, to which paths in it are relative; empty:
                                               // that of the file
  SceneLimits limits = {};
  // Values in place of the file's: a path such as light.ambient_lux or objects.2.count, and YAML.
  std::vector<std::pair<std::string, std::string>> changes = {};
  std::filesystem::path rig_file = {};  // read instead of the one that the file names
};

// The rig as its calibration has it.
RigModel calibration_of(const Scene& scene);

// Throws Error with file:line on anything that is missing, unknown, not finite, out of range or impossible.
Scene load_scene(const std::filesystem::path& file, const SceneReading& reading = {});

}  // namespace fringeslam::sim
