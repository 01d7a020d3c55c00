// SPDX-License-Identifier: Apache-2.0
#include "tools/evaluation_dataset.h"

#include <link.h>

#include "core/base/fnv.h"
#include "core/io/files.h"
#include "core/io/tum_file.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "sim/scene/cache.h"
#include "tools/bag/bag_dataset.h"
#include "tools/euroc.h"
#include "tools/interrupt.h"
#include "tools/map_truth.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/tum_rgbd.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kKind = "evaluation dataset";
constexpr const char* kBagFile = "views.bag";

// Hash of the program and of its libraries: another build may render other images.
std::string build_hash() {
  static const std::string hash = [] {
    std::string files = "/proc/self/exe";
    const auto add = [](dl_phdr_info* info, size_t, void* list) {
      const std::string name = info->dlpi_name;
      if (name.find("libfringeslam") != std::string::npos) *static_cast<std::string*>(list) += "\n" + name;
      return 0;
    };
    dl_iterate_phdr(add, &files);
    std::string hashes;
    for (size_t begin = 0; begin < files.size();) {
      const size_t end = std::min(files.find('\n', begin), files.size());
      hashes += std::to_string(fnv1a(read_bytes(files.substr(begin, end - begin)))) + "\n";
      begin = end + 1;
    }
    return hashes;
  }();
  return hash;
}

// Renders fringe images into `dataset`, and what scoring needs into `truth`. Returns false if interrupted.
bool render_fringes(Source& source, const fs::path& dataset, const fs::path& truth, const Common& common) {
  fs::create_directories(dataset);
  fs::create_directories(truth);
  const auto rig = source.open(truth);
  RecordingRig recording(*rig, dataset);
  Progress progress("rendering " + source.name(), source.stacks(), common.quiet || common.json);
  int stacks = 0;
  for (; recording.capture(source.sequence()); ++stacks) {
    fs::remove(truth / "truth" / (stack_name(stacks) + ".exr"));  // megabytes per view that scoring does not need
    progress.step();
    if (interrupted()) return false;
  }
  recording.finish(source.name(), source.seed(), false);
  fs::copy_file(dataset / "rig.yaml", truth / "rig.yaml");
  return true;
}

void render_rgbd(Source& source, const Settings& settings, const fs::path& dataset, const fs::path& truth,
                 const Common& common) {
  write_tum_rgbd(source, settings, {}, dataset, common);
  fs::create_directories(truth);
  fs::copy_file(dataset / "rig.yaml", truth / "rig.yaml");
  for (const char* file : {kTumTruthFile, kResolvedFile, "render.yaml"}) fs::rename(dataset / file, truth / file);
}

void render_euroc(Source& source, const Settings& settings, const fs::path& dataset, const fs::path& truth,
                  const Common& common) {
  const WrittenViews written = write_euroc(source, settings, {}, false, dataset, common);
  fs::create_directories(truth);
  fs::copy_file(dataset / "rig.yaml", truth / "rig.yaml");
  for (const char* file : {kResolvedFile, "render.yaml"}) fs::rename(dataset / file, truth / file);
  write_camera_truth(truth / kTumTruthFile, camera_trajectory(written.robot, source.model()));
}

void render_bag(Source& source, const Settings& settings, const fs::path& dataset, const fs::path& truth,
                const Common& common) {
  fs::create_directories(dataset);
  const WrittenViews written = write_bag(source, settings, {}, false, dataset / kBagFile, common);
  fs::create_directories(truth);
  write_text(truth / "rig.yaml", to_yaml(source.model()));
  write_camera_truth(truth / kTumTruthFile, camera_trajectory(written.robot, source.model()));
}

}  // namespace

std::optional<EvaluationDataset> evaluation_dataset(const evaluation::SuiteDataset& wanted, DatasetFormat format,
                                                    const Common& common) {
  const SceneVariant variant{wanted.seed, wanted.with};
  const fs::path cache = fs::absolute(sim::cache_folder()) / "evaluation";
  sim::SceneLoadOptions reading = variant.reading();
  reading.resolved_for = cache / "HASH" / "truth";  // relative paths are the same from any folder there
  std::vector<fs::path> files;
  reading.files = &files;
  const sim::Scene scene = sim::load_scene(scene_file(wanted.scene), reading);
  EvaluationDataset result;
  // A resolved scene has the names of its meshes only.
  result.hash = sim::content_hash(std::string(to_string(format)) + "\n" + fs::absolute(wanted.scene).string() + "\n" +
                                  scene.resolved + to_yaml(sim::calibration_of(scene)) + sim::contents_hash(files) +
                                  build_hash());
  const fs::path folder = cache / result.hash;
  if (!fs::exists(folder)) {
    const Settings settings;
    const auto source = open_source(wanted.scene, variant, settings, false);
    fs::create_directories(cache);
    StagedFolder staged(folder, kKind);
    const fs::path dataset = staged.path() / "dataset", truth = staged.path() / "truth";
    if (format == DatasetFormat::tum_rgbd)
      render_rgbd(*source, settings, dataset, truth, common);
    else if (format == DatasetFormat::euroc)
      render_euroc(*source, settings, dataset, truth, common);
    else if (format == DatasetFormat::rosbag)
      render_bag(*source, settings, dataset, truth, common);
    else if (!render_fringes(*source, dataset, truth, common))
      return std::nullopt;
    write_text(truth / kResolvedFile, scene.resolved);
    staged.commit();
  }
  result.dataset = folder / "dataset";
  if (format == DatasetFormat::rosbag) result.dataset /= kBagFile;
  result.truth = folder / "truth";
  result.poses = read_tum(true_trajectory_file(result.truth));
  return result;
}

}  // namespace fringeslam::tools
