// SPDX-License-Identifier: Apache-2.0
#include "tools/source.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <utility>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/tum_file.h"
#include "core/io/yaml.h"
#include "core/rig/dataset.h"
#include "tools/board_file.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kRenderFile = "render.yaml";
// In the truth folder.
constexpr const char* kPosesFile = "truth.tum";
constexpr const char* kExposuresFile = "exposures.tum";

// Renders a scene and writes the ground truth of every view into `folder`: its images, its pose into truth.tum, and the
// pose of every exposure into exposures.tum.
class SceneRig : public Rig {
 public:
  SceneRig(const sim::Scene& scene, const sim::RenderOptions& options, fs::path folder)
      : rig_(scene, options), folder_(std::move(folder)), poses_known_(!scene.path) {
    if (poses_known_) write_text(folder_ / kPosesFile, to_tum(scene.trajectory));
  }
  const RigModel& model() const override { return rig_.model(); }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override {
    std::optional<sim::SimulatedView> view = rig_.simulate(sequence);
    if (!view) return std::nullopt;
    sim::write_truth(view->truth, folder_);
    if (!poses_known_) append(kPosesFile, {{view->truth.timestamp_s, view->truth.world_from_robot}});
    append(kExposuresFile, view->truth.exposures);
    return std::move(view->stack);
  }

 private:
  void append(const char* file, const Trajectory& poses) {
    const fs::path path = folder_ / file;
    std::ofstream stream(path, std::ios::app);
    stream << to_tum(poses) << std::flush;
    if (!stream) throw Error(path.string() + ": cannot be written");
  }

  sim::VirtualRig rig_;
  fs::path folder_;
  bool poses_known_;  // before rendering
};

class SceneSource : public Source {
 public:
  SceneSource(const fs::path& file, const SceneVariant& variant, const Settings& settings)
      : scene_(loaded(file, variant.reading())),
        model_(sim::calibration_of(scene_)),
        settings_(settings),
        board_(file.parent_path() / kBoardFile) {
    for (const std::string& note : scene_.notes) std::fprintf(stderr, "%s\n", single_line(note).c_str());
  }
  const std::string& name() const override { return scene_.name; }
  uint64_t seed() const override { return scene_.seed; }
  void recalibrate(const RigModel&) override {
    throw Error(board_.parent_path().string() + ": is a scene with its own rig; --rig applies to datasets");
  }
  int stacks() const override {
    if (!scene_.path) return static_cast<int>(scene_.trajectory.size());
    const double images_per_view = static_cast<double>(scene_.patterns.patterns.size());
    const double rate_hz =
        scene_.view_rate_hz > 0 ? scene_.view_rate_hz : scene_.rig.timing.camera_rate_hz / images_per_view;
    return std::max(1, static_cast<int>(scene_.path->duration_s() * rate_hz));
  }
  bool has_truth() const override { return true; }
  bool may_move() const override { return scene_.moves_while_capturing(); }
  fs::path truth(const fs::path& opened) const override { return opened / "truth"; }
  const PatternSequence& sequence() const override { return scene_.patterns; }
  const RigModel& model() const override { return model_; }
  void undistort() override {
    scene_.rig.camera.distortion = {};
    model_ = sim::calibration_of(scene_);
  }
  fs::path board_file() const override { return board_; }
  std::vector<fs::path> inputs() const override {
    std::vector<fs::path> all = files_;
    all.push_back(board_);
    return all;
  }

  std::unique_ptr<Rig> open(const fs::path& folder) override {
    const fs::path truth = folder / "truth";
    fs::create_directories(truth);
    write_text(folder / kRenderFile, render_yaml(settings_));
    write_text(folder / kResolvedFile, scene_.resolved);
    if (scene_.commanded && !scene_.path) write_text(folder / kStageFile, to_tum(scene_.trajectory));
    return std::make_unique<SceneRig>(scene_, settings_.render, truth);
  }

 private:
  sim::Scene loaded(const fs::path& file, sim::SceneLoadOptions reading) {
    reading.files = &files_;
    reading.resolved_for = "/";  // it is written to another folder, and copied from a dataset to its runs
    return sim::load_scene(file, reading);
  }

  std::vector<fs::path> files_;  // of the scene; before it, because they are listed while it is loaded
  sim::Scene scene_;
  RigModel model_;
  Settings settings_;
  fs::path board_;
};

class DatasetSource : public Source {
 public:
  explicit DatasetSource(const fs::path& folder) : folder_(folder), rig_(std::make_unique<ReplayRig>(folder)) {
    info_ = rig_->info();
    sequence_ = rig_->sequence();
    model_ = rig_->model();
    if (!info_.has_truth) return;
    require_truth(kPosesFile);
    for (int index = 0; index < info_.stacks; ++index) require_truth(stack_name(index) + ".exr");
    check_truth_times();
  }
  const std::string& name() const override { return info_.name; }
  uint64_t seed() const override { return info_.seed; }
  int stacks() const override { return info_.stacks; }
  bool has_truth() const override { return info_.has_truth; }
  fs::path truth(const fs::path&) const override { return folder_ / "truth"; }
  bool imported() const override { return info_.imported; }
  bool has_image_times() const override { return !info_.imported || info_.image_times; }
  const PatternSequence& sequence() const override { return sequence_; }
  const RigModel& model() const override { return model_; }
  void recalibrate(const RigModel& calibration) override {
    rig_->recalibrate(calibration);
    model_ = rig_->model();
  }
  void undistort() override {
    if (!model_.camera.distortion.is_zero())
      throw Error(folder_.string() + ": its images have lens distortion; add --distorted to keep it");
  }
  fs::path board_file() const override { return folder_ / kBoardFile; }
  std::vector<fs::path> inputs() const override { return {folder_}; }

  std::unique_ptr<Rig> open(const fs::path& folder) override {
    if (info_.has_truth) link_input_folder(folder_ / "truth", folder / "truth");
    if (fs::exists(folder_ / kStageFile)) copy_input(folder_ / kStageFile, folder / kStageFile);
    for (const char* file : {kRenderFile, kResolvedFile}) {
      if (fs::exists(folder_ / file)) copy_input(folder_ / file, folder / file);
    }
    return std::move(rig_);
  }

 private:
  // The truth of another recording would be compared with the wrong views, or with none.
  void check_truth_times() const {
    constexpr double kMostDifference_s = 1e-6;  // truth.tum has nine decimals
    const fs::path file = folder_ / "truth" / kPosesFile;
    const Trajectory truth = read_tum(file);
    if (truth.size() < static_cast<size_t>(info_.stacks))
      throw Error(file.string() + ": has " + std::to_string(truth.size()) + " poses, but " + kDatasetFile + " lists " +
                  std::to_string(info_.stacks) + " stacks");
    for (int index = 0; index < info_.stacks; ++index) {
      const fs::path stack = folder_ / "stacks" / stack_name(index) / "stack.yaml";
      const double time_s = YamlMap::load(stack).number("timestamp_s", {0, 1e12});
      if (const double true_s = truth[static_cast<size_t>(index)].timestamp_s;
          !(std::abs(true_s - time_s) <= kMostDifference_s))
        throw Error(file.string() + ": pose " + std::to_string(index) + " is at " + to_text(true_s) + " s, but " +
                    stack.string() + " is at " + to_text(time_s) + " s; the ground truth is of another recording");
    }
  }
  void require_truth(const std::string& file) const {
    const fs::path path = folder_ / "truth" / file;
    if (!fs::exists(path))
      throw Error(path.string() + ": is missing, although " + kDatasetFile + " declares ground truth");
  }

  fs::path folder_;
  std::unique_ptr<ReplayRig> rig_;
  DatasetInfo info_;
  PatternSequence sequence_;
  RigModel model_;
};

}  // namespace

void SceneVariant::add_to(Command verb) {
  verb.add_option("--seed", seed, "Seed; overrides the scene's").check_non_negative();
  verb.add_option("--with", with,
                  "Override a value of the scene: light.ambient_lux=2000, objects.2.count=30, "
                  "rig.camera.sensor.dark_noise_electrons=50 (repeatable)");
}

sim::SceneLoadOptions SceneVariant::reading() const {
  sim::SceneLoadOptions reading{seed};
  for (const std::string& change : with) {
    const size_t equals = change.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == change.size())
      throw Error("--with " + change + ": must look like section.key=value, for example light.ambient_lux=2000");
    reading.changes.emplace_back(change.substr(0, equals), change.substr(equals + 1));
  }
  return reading;
}

std::unique_ptr<Source> open_source(const fs::path& given, const SceneVariant& variant, const Settings& settings,
                                    bool uses_render) {
  std::error_code ignored;
  const fs::path path = fs::exists(given, ignored) ? given : scene_file(given);  // the name of an installed scene
  if (!fs::exists(path, ignored)) throw Error(path.string() + ": does not exist; give a scene or a dataset folder");
  if (fs::exists(path / kDatasetFile, ignored)) {
    if (variant.seed || !variant.with.empty())
      throw Error(path.string() + ": --seed and --with have no effect on a recorded dataset; leave them out");
    if (uses_render) throw Error(path.string() + ": render.* settings have no effect on a recorded dataset");
    return std::make_unique<DatasetSource>(path);
  }
  if (fs::is_directory(path, ignored)) {
    std::error_code failed;
    if (!fs::exists(path / kSceneFile, failed) && failed == std::errc::permission_denied)
      throw Error(path.string() + ": cannot be read: permission denied");
    if (!fs::exists(path / kSceneFile, ignored))
      throw Error(path.string() + ": contains neither " + kSceneFile + " nor " + kDatasetFile);
    return std::make_unique<SceneSource>(path / kSceneFile, variant, settings);
  }
  return std::make_unique<SceneSource>(path, variant, settings);
}

}  // namespace fringeslam::tools
