// SPDX-License-Identifier: Apache-2.0
// The image source of a run: a scene to be rendered, or a recorded dataset. Both write the same files into the run
// folder, so that a run of a rendered dataset equals a run of its scene byte for byte.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/rig/rig.h"
#include "sim/scene/data_folder.h"
#include "tools/command_line.h"
#include "tools/settings.h"

namespace fringeslam::tools {

// Commanded poses of a rendered robot.
constexpr const char* kStageFile = "stage.tum";

using sim::kSceneFile;
// The scene from which a run or dataset was rendered, with absolute paths.
constexpr const char* kResolvedFile = "resolved_scene.yaml";
using sim::scene_file;

class Source {
 public:
  virtual ~Source() = default;
  virtual const std::string& name() const = 0;
  virtual uint64_t seed() const = 0;
  virtual int stacks() const = 0;  // estimated for continuous motion, where it depends on the patterns requested
  virtual bool has_truth() const = 0;
  // Folder of the ground truth, of which open() writes or links a part into truth/ of the folder that it was given.
  // Reading it here lets messages name the user's file.
  virtual std::filesystem::path truth(const std::filesystem::path& opened) const = 0;
  // True if the images are those of another rig, whose near_m and far_m bound the depths.
  virtual bool imported() const { return false; }
  // True if motion during the stacks can be estimated.
  virtual bool has_image_times() const { return true; }
  // False if the robot is known to stand during each stack.
  virtual bool may_move() const { return true; }
  virtual const PatternSequence& sequence() const = 0;
  virtual const RigModel& model() const = 0;
  // Replaces lenses and relative pose by those of a calibration. Throws Error for scenes, whose rig is part of them.
  virtual void recalibrate(const RigModel& calibration) = 0;
  // Removes the camera's lens distortion from images that are still to be rendered. Throws Error if the images are
  // recorded and distorted.
  virtual void undistort() = 0;
  // Path of the board file of a calibration scene or dataset; need not exist.
  virtual std::filesystem::path board_file() const = 0;
  // Files and folders that the source reads, which the verb must not replace; some need not exist.
  virtual std::vector<std::filesystem::path> inputs() const = 0;
  // Returns the rig and writes the files that document the images' origin (render.yaml, truth/) into `folder`.
  virtual std::unique_ptr<Rig> open(const std::filesystem::path& folder) = 0;
};

// Changes to a scene on the command line.
struct SceneVariant {
  std::optional<uint64_t> seed;
  std::vector<std::string> with;  // such as light.ambient_lux=2000

  // Adds --seed and --with to the verb.
  void add_to(Command verb);
  // Throws Error if one of `with` is not an assignment.
  sim::SceneLoadOptions reading() const;
};

// Opens a scene file, a folder with scene.yaml, or a dataset folder. `uses_render` is true if a render.* setting was
// given. Throws Error if `path` is none of these, or if settings have no effect on a dataset.
std::unique_ptr<Source> open_source(const std::filesystem::path& path, const SceneVariant& variant,
                                    const Settings& settings, bool uses_render);

}  // namespace fringeslam::tools
