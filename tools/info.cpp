// SPDX-License-Identifier: Apache-2.0
// fringeslam info PATH: prints the contents of a scene, dataset, run, rig or PLY file.
#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"
#include "core/io/ply.h"
#include "core/io/tum_file.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "sim/light/photometry.h"
#include "sim/scene/scene.h"
#include "tools/run_score.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;

Json describe(const RigModel& rig) {
  return {{"rig", rig.name},
          {"camera_px", {rig.camera.width, rig.camera.height}},
          {"camera_bits", rig.sensor.bits},
          {"view_at_1m_mm", {1e3 * rig.camera.width / rig.camera.fx, 1e3 * rig.camera.height / rig.camera.fy}},
          {"projector_px", {rig.projector.width, rig.projector.height}},
          {"baseline_mm", 1e3 * translation_m(rig.projector_from_camera)},
          {"exposure_ms", 1e3 * rig.timing.exposure_s},
          {"projector_lux_at_1m", sim::projector_lux_at_1m(rig)},
          {"white_electrons_at_1m", sim::white_electrons_at_1m(rig)},
          {"range_m", {rig.near_m, rig.far_m}}};
}

Json describe(const PatternSequence& sequence) {
  Json periods = Json::array();
  for (const FringeGroup& group : fringe_groups(sequence, sequence.patterns.front().axis))
    periods.push_back({{"period_px", group.period_px}, {"steps", group.images.size()}});
  return {{"images_per_stack", sequence.patterns.size()}, {"fringes", periods}};
}

Json describe(const PlyMap& map) {
  Json json = {{"kind", map.triangles.empty() ? "points" : "mesh"},
               {"vertices", map.vertices.size()},
               {"triangles", map.triangles.size()},
               {"dropped", map.dropped}};
  if (map.vertices.empty()) return json;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& vertex : map.vertices) box.extend(vertex);
  json["from_m"] = {box.min().x(), box.min().y(), box.min().z()};
  json["to_m"] = {box.max().x(), box.max().y(), box.max().z()};
  return json;
}

Json describe_scene(const fs::path& file) {
  const sim::Scene scene = sim::load_scene(file);
  size_t triangles = 0;
  for (const sim::Object& object : scene.objects) triangles += object.mesh->triangles.size();
  Json json = {{"kind", "scene"},        {"name", scene.name},
               {"seed", scene.seed},     {"objects", scene.objects.size()},
               {"triangles", triangles}, {"poses", scene.trajectory.size()}};
  json.update(describe(scene.rig));
  json.update(describe(scene.patterns));
  return json;
}

Json describe_path(const fs::path& path) {
  if (!fs::exists(path)) throw Error(path.string() + ": does not exist");
  if (fs::exists(path / kDatasetFile)) {
    const ReplayRig rig(path);
    Json json = {{"kind", "dataset"},
                 {"name", rig.info().name},
                 {"seed", rig.info().seed},
                 {"stacks", rig.info().stacks},
                 {"truth", rig.info().has_truth}};
    json.update(describe(rig.model()));
    json.update(describe(rig.sequence()));
    return json;
  }
  if (fs::exists(path / "trajectory.tum")) {
    Json json = {{"kind", "run"}, {"poses", read_tum(path / "trajectory.tum").size()}};
    json.update(describe(read_rig(path / "rig.yaml")));
    return json;
  }
  if (fs::exists(path / "scene.yaml")) return describe_scene(path / "scene.yaml");
  if (fs::is_directory(path)) throw Error(path.string() + ": is not a scene, dataset or run");
  if (path.filename() == "scene.yaml") return describe_scene(path);
  if (path.extension() == ".ply") return describe(read_ply(path));
  if (path.extension() == ".map") throw Error(path.string() + ": is a saved map; use fringeslam map info");
  Json json = {{"kind", "rig"}};
  json.update(describe(read_rig(path)));
  return json;
}

}  // namespace

Verb add_info(Command app, const Common& common) {
  auto path = std::make_shared<std::string>();
  const Command verb = app.add_subcommand("info", "Print the contents of a scene, dataset, run, rig or PLY file");
  verb.add_option("path", *path, "Folder or file").required();
  return [path, &common] {
    const Json json = describe_path(*path);
    if (common.json) {
      std::printf("%s\n", json_text(json, 2).c_str());
    } else {
      for (const auto& [key, value] : json.items())
        std::printf("%-18s %s\n", key.c_str(),
                    single_line(value.is_string() ? value.get<std::string>() : json_text(value)).c_str());
    }
    return 0;
  };
}

}  // namespace fringeslam::tools
