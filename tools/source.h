// SPDX-License-Identifier: Apache-2.0
// What a run takes its images from: a scene that is rendered, or a recorded dataset. Both leave the same
// files in the run folder, so that a run of a rendered dataset equals a run of its scene byte for byte.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/rig/rig.h"
#include "tools/settings.h"

namespace fringeslam::tools {

// Poses that a rendered robot was told to take.
constexpr const char* kStageFile = "stage.tum";

// The scene file that a path means: itself, or scene.yaml in a folder.
constexpr const char* kSceneFile = "scene.yaml";
// The scene that a run or dataset was rendered from, beside its rig.yaml.
constexpr const char* kResolvedFile = "resolved_scene.yaml";
std::filesystem::path scene_file(const std::filesystem::path& path);

class Source {
 public:
  virtual ~Source() = default;
  virtual const std::string& name() const = 0;
  virtual uint64_t seed() const = 0;
  virtual int stacks() const = 0;
  virtual bool has_truth() const = 0;
  virtual const PatternSequence& sequence() const = 0;
  virtual const RigModel& model() const = 0;
  // From now on the camera's lens does not distort. Throws Error where the images are there already and are distorted.
  virtual void undistort() = 0;
  // Of the board that a calibration scene or dataset shows; need not exist.
  virtual std::filesystem::path board_file() const = 0;
  // The rig; the files that tell where the images came from (render.yaml, truth/) are put into `folder`.
  virtual std::unique_ptr<Rig> open(const std::filesystem::path& folder) = 0;
};

// What of a scene is other than its file says.
struct SceneVariant {
  std::optional<uint64_t> seed;
  std::vector<std::string> with;  // light.ambient_lux=2000

  void add_to(CLI::App& verb);
  // Throws Error when one of `with` is no assignment.
  sim::SceneReading reading() const;
};

// `path`: a scene file, a folder with scene.yaml, or a dataset folder. `uses_render`: some render.* was set.
std::unique_ptr<Source> open_source(const std::filesystem::path& path, const SceneVariant& variant,
                                    const Settings& settings, bool uses_render);

}  // namespace fringeslam::tools
