// SPDX-License-Identifier: Apache-2.0
// Scene description: objects with materials, light, rig and trajectory. Read from scene.yaml (keys in
// scenes/README.md); all random values are drawn from the seed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/io/yaml_value.h"
#include "core/patterns/patterns.h"
#include "core/types/rig_model.h"
#include "core/types/trajectory.h"
#include "sim/scene/continuous_path.h"
#include "sim/scene/material.h"
#include "sim/scene/mesh.h"

namespace fringeslam::sim {

struct Object {
  std::string name;                  // "object N", for messages
  std::string place = {};            // file:line of its entry
  std::string path = {};             // of its entry as in SceneLoadOptions::changes, if it is the only object of that
  std::shared_ptr<const Mesh> mesh;  // may be shared by several objects
  Pose world_from_object;
  Material material;
  uint32_t texture_seed = 0;
};

// Homogeneous participating medium: smoke or airborne dust (docs/method.md, section 12.3).
struct Air {
  double extinction_per_m = 0;  // sigma_t
  double albedo = 0.9;          // single-scattering albedo: scattering over extinction
  double anisotropy = 0.5;      // mean cosine g of the Henyey-Greenstein phase function
  // Long-wave infrared extinction relative to visible extinction; small for smoke, whose particles are finer than 1 um.
  double infrared_share = 0.1;
};

// Settled grey dust: covers the albedo and gloss of upward-facing surfaces.
struct Dust {
  double cover = 0;  // covered fraction of a horizontal surface, 0 to 1
  double albedo = 0.35;
  double max_slope_deg = 60;  // steeper surfaces stay clean
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  // Dust temperature as a fraction of the way from the ambient temperature to that of the surface beneath.
  double warmed_share = 0.7;
};

// Water on surfaces: a film in patches, and puddles where these are level.
struct Water {
  double cover = 0;             // wet share of the surfaces
  double patch_m = 0.1;         // size of the patches
  double roughness = 0.2;       // of a film, which follows the surface below it
  double puddle_slope_deg = 5;  // wet surfaces up to this slope are puddles with a smooth, level surface
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
};

// Robot motion during the capture of an image stack (docs/method.md, section 9).
struct Motion {
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();  // in the robot frame
  Eigen::Vector3d angular_rad_s = Eigen::Vector3d::Zero();
  bool still() const { return velocity_m_s.isZero() && angular_rad_s.isZero(); }
};

// Error of the calibration given to the pipeline, relative to the rig that renders the images.
struct CalibrationError {
  Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();  // of camera_from_projector
  Eigen::Vector3d angles_deg = Eigen::Vector3d::Zero();     // of camera_from_projector
  double focal = 0;                                         // relative error of the camera's focal length
};

struct Scene {
  std::string name;
  uint64_t seed = 0;
  std::vector<Object> objects;
  RigModel rig;
  PatternSequence patterns;
  double ambient_lux = 0;      // uniform light from all directions
  int bounces = 0;             // interreflections between surfaces
  bool auto_exposure = false;  // false: use the rig's exposure
  double surroundings_c = 20;  // temperature of the air, the surroundings and materials without their own
  Air air;
  Dust dust;
  Water water;
  Motion motion;
  CalibrationError calibration_error;
  Trajectory trajectory;                    // of the robot; with a path: the poses along it every interval_s
  std::optional<ContinuousPath> path = {};  // the robot moves continuously; the rig's clock determines the views
  double view_rate_hz = 0;                  // with a path: views per second; 0: without pause
  std::string resolved = {};            // scene file with includes merged and distributions replaced by drawn values
  std::vector<std::string> notes = {};  // messages for the user, e.g. summaries of imported meshes
  bool commanded = false;               // true if the poses are known to the motion controller (written to stage.tum)

  // True if the images of a stack have different poses.
  bool moves_while_capturing() const { return path || !motion.still(); }
};

// Limits on scene size, which keep a scene file from exhausting memory or time.
struct SceneLimits {
  size_t objects = 100000;
  int scattered = 10000;          // objects per scatter or pile, whose run time is quadratic
  size_t triangles = 30'000'000;  // over all distinct meshes
  int views = 100000;
};

// A value of a scene's files.
struct SceneValue : YamlValue {
  bool changeable = true;  // by SceneLoadOptions::changes; false: by editing its file only
};

struct SceneLoadOptions {
  std::optional<uint64_t> seed = {};           // overrides the file's seed
  std::vector<std::string>* errors = nullptr;  // if set, collects all errors; the scene is invalid if there are any
  // Folder that paths in Scene::resolved are relative to; empty: the scene file's folder; the root folder: they are absolute,
  // so that the text has the same meaning in any folder.
  std::filesystem::path resolved_for = {};
  SceneLimits limits = {};
  // Overrides of the file's values: a key path such as light.ambient_lux or objects.2.count, and a YAML value. They
  // precede those in the scene's section `placed`.
  std::vector<std::pair<std::string, std::string>> changes = {};
  std::filesystem::path rig_file = {};  // overrides the scene's rig file
  // Content of the scene file, which need not exist then: its path serves for messages and relative paths. Empty: read
  // the file.
  std::string text = {};
  // If set, receives the files on which the scene depends, as far as they are known, also if loading fails: scene file,
  // included files, rig, meshes with their materials, textures, trajectory.
  std::vector<std::filesystem::path>* files = nullptr;
  // If set, receives the numbers of the scene and all values drawn, also if loading fails.
  std::vector<SceneValue>* values = nullptr;
};

// Returns the rig with the scene's calibration error applied, as given to the pipeline.
RigModel calibration_of(const Scene& scene);

// Loads a scene file. Throws Error with file:line on missing, unknown, non-finite, out-of-range or inconsistent values.
Scene load_scene(const std::filesystem::path& file, const SceneLoadOptions& reading = {});

}  // namespace fringeslam::sim
