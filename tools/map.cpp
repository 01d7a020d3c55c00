// SPDX-License-Identifier: Apache-2.0
// fringeslam map merge A B
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/base/constants.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/ply_writer.h"
#include "core/io/staged.h"
#include "core/map/map_cloud.h"
#include "core/map/map_file.h"
#include "core/mapper/map_merge.h"
#include "core/rig/rig_file.h"
#include "tools/progress.h"
#include "tools/settings.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;

struct MergeArguments {
  std::string a, b, out;
  std::vector<std::string> sets;
};

// A map file, or that of a run folder.
fs::path map_file(const std::string& name) {
  const fs::path file = fs::is_directory(name) ? fs::path(name) / kMapFile : fs::path(name);
  if (!fs::exists(file))
    throw Error(name + ": contains no " + std::string(kMapFile) +
                "; write it with `run --save-map`, or give the map file");
  return file;
}

Json rows_of(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    Json& list = rows.emplace_back(Json::array());
    for (Eigen::Index col = 0; col < matrix.cols(); ++col) list.push_back(matrix(row, col));
  }
  return rows;
}

Json json_of(const Pose& pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = pose.rotation;
  matrix.topRightCorner<3, 1>() = pose.translation;
  return rows_of(matrix);
}

Json to_json(const MergedMap& merged, const MergeArguments& arguments, int keyframes_of_a) {
  Json json = {{"a", arguments.a},
               {"b", arguments.b},
               {"keyframes", merged.map.keyframes().size()},
               {"keyframes_of_a", keyframes_of_a},
               {"a_from_b", json_of(merged.a_from_b)},
               {"covariance", rows_of(merged.covariance)},
               {"contradicting", merged.contradicting},
               {"links", Json::array()}};
  for (const CrossLink& link : merged.links)
    json["links"].push_back({{"a", link.a},
                             {"b", link.b},
                             {"by", link.by_landmarks ? "landmarks" : "depth"},
                             {"accepted", link.accepted},
                             {"a_from_b", json_of(link.a_from_b)},
                             {"covariance", rows_of(link.covariance)}});
  return json;
}

void write_cloud(const fs::path& file, const KeyframeMap& map, const CloudOptions& options) {
  PlyWriter writer(file, {"world", 0, true, true, std::nullopt});
  for_each_cloud_part(map, options, [&](const std::vector<CloudPoint>& part) { writer.add(part); });
  writer.finish();
}

int merge(const MergeArguments& arguments, const Common& common) {
  const Settings settings = parse_settings(arguments.sets);
  const fs::path file_a = map_file(arguments.a), file_b = map_file(arguments.b);
  const fs::path rig_file = file_a.parent_path() / "rig.yaml";
  if (!fs::exists(rig_file))
    throw Error(file_a.string() + ": has no rig.yaml beside it; keep the map in the folder of its run");
  const RigModel rig = read_rig(rig_file);
  const auto load = [&](const fs::path& file) {
    return map_from_bytes(read_bytes(file), file.string(), rig, settings.pipeline.mapping);
  };
  const KeyframeMap a = load(file_a), b = load(file_b);
  StagedFolder folder(arguments.out, "merge");
  const auto keyframes_of_b = static_cast<int>(b.keyframes().size());
  Progress progress("comparing keyframes", keyframes_of_b, common.quiet || common.json);
  const MergedMap merged =
      merge_maps(a, b, settings.pipeline.mapper(), arguments.b, [&](int, int) { progress.step(); });
  const Json json = to_json(merged, arguments, static_cast<int>(a.keyframes().size()));
  write_text(folder.path() / kMapFile, to_bytes(merged.map));
  write_text(folder.path() / "rig.yaml", to_yaml(rig));
  write_text(folder.path() / "merge.json", json_text(json, 2) + "\n");
  write_cloud(folder.path() / "map.ply", merged.map, settings.pipeline.cloud);
  folder.commit();

  const auto accepted =
      std::count_if(merged.links.begin(), merged.links.end(), [](const auto& l) { return l.accepted; });
  const auto sigma = [&](int first) { return std::sqrt(merged.covariance.diagonal().segment<3>(first).mean()); };
  char line[256];
  std::snprintf(line, sizeof line,
                "merged: %zu and %d keyframes by %td links; B is %.3f m from A, sigma %.2f mm and %.4f degrees\n"
                "written: %s",
                a.keyframes().size(), keyframes_of_b, accepted, translation_m(merged.a_from_b), 1e3 * sigma(3),
                sigma(0) * 180 / kPi, arguments.out.c_str());
  print_result(common, json, line);
  return 0;
}

}  // namespace

Verb add_map(Command app, const Common& common) {
  auto arguments = std::make_shared<MergeArguments>();
  const Command group = app.add_subcommand("map", "Work with saved maps");
  group.require_subcommand(1);
  const Command verb = group.add_subcommand(
      "merge", "Merge the saved maps of two missions or robots that saw the same place, with covariance");
  verb.add_option("a", arguments->a, "Map that stays in place: a run folder with saved.map, or a map file").required();
  verb.add_option("b", arguments->b, "Map to place in it, of the same camera").required();
  verb.add_option("--out", arguments->out, "Folder to write: saved.map, merge.json, map.ply").required();
  verb.add_option("--set", arguments->sets, "Setting: stage.key=value (repeatable; see `run --help`)");
  return [arguments, &common] { return merge(*arguments, common); };
}

}  // namespace fringeslam::tools
