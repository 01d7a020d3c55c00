// SPDX-License-Identifier: Apache-2.0
// fringeslam map merge A B, map info, map recover
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
#include "core/mapper/map_merge.h"
#include "core/rig/rig_file.h"
#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/saved_map.h"
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
  const auto load = [&](const fs::path& file) { return open_map(file, rig, settings.pipeline.mapping); };
  const KeyframeMap a = load(file_a), b = load(file_b);
  require_not_an_input(arguments.out, {file_a, file_b, rig_file});
  StagedFolder folder(arguments.out, "merge");
  const auto keyframes_of_b = static_cast<int>(b.keyframes().size());
  Progress progress("comparing keyframes", keyframes_of_b, common.quiet || common.json);
  const MergedMap merged =
      merge_maps(a, b, settings.pipeline.mapper(), arguments.b, [&](int, int) { progress.step(); });
  const Json json = to_json(merged, arguments, static_cast<int>(a.keyframes().size()));
  write_map(folder.path() / kMapFile, merged.map);
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

struct InfoArguments {
  std::string map;
  bool verify = false;
};

int info(const InfoArguments& arguments, const Common& common) {
  const fs::path file = map_file(arguments.map);
  const auto [content, bytes] = read_map_info(file);
  const MapIndex& map = content.index;
  if (arguments.verify) verify_map(file);
  const auto loops = std::count_if(map.links.begin(), map.links.end(), [](const PoseEdge& link) { return link.loop; });
  double path_m = 0;
  for (size_t i = 1; i < map.keyframes.size(); ++i)
    path_m += translation_m(map.keyframes[i - 1].world_from_camera.inverse() * map.keyframes[i].world_from_camera);
  const double seconds = map.keyframes.back().timestamp_s - map.keyframes.front().timestamp_s;
  const Json json = {{"map", file.string()},
                     {"keyframes", map.keyframes.size()},
                     {"frames", map.frames.size()},
                     {"links", map.links.size()},
                     {"loops", loops},
                     {"camera_px", {map.image_size().width, map.image_size().height}},
                     {"path_m", path_m},
                     {"seconds", seconds},
                     {"bytes", bytes},
                     {"verified", arguments.verify}};
  char line[256];
  std::snprintf(
      line, sizeof line,
      "%zu keyframes, %zu frames, %zu links, %td of them loops; camera of %d x %d px; %.1f m, %.0f s; %.1f MiB%s",
      map.keyframes.size(), map.frames.size(), map.links.size(), loops, map.image_size().width, map.image_size().height,
      path_m, seconds, static_cast<double>(bytes) / (1 << 20), arguments.verify ? "; all checksums are right" : "");
  print_result(common, json, line);
  report_left_maps(file.has_parent_path() ? file.parent_path() : fs::path("."));
  return 0;
}

struct RecoverArguments {
  std::string run, out;
};

// Recovers the map of one run that died. Several may have tried the same result.
int recover(const RecoverArguments& arguments, const Common& common) {
  fs::path run = arguments.run;
  while (run.filename().empty() && run.has_relative_path()) run = run.parent_path();
  const std::vector<LeftMap> left = left_maps(run);
  if (left.empty())
    throw Error(arguments.run + ": there is no map to restore; give the run folder as in `run --out`, whose run with " +
                "--save-map ended early");
  const auto best = std::max_element(left.begin(), left.end(),
                                     [](const LeftMap& a, const LeftMap& b) { return a.keyframes < b.keyframes; });
  if (best->keyframes == 0) throw Error(best->message);
  const std::string out = arguments.out.empty() ? run.string() + ".recovered" : arguments.out;
  WorkFolder journal = WorkFolder::taken_over(best->folder);
  StagedFolder folder(out, "");  // never replaces another map
  const RecoveredMap recovered = recover_map(journal, folder.path() / kMapFile);
  if (const fs::path rig = journal.path() / "rig.yaml"; fs::exists(rig))
    write_text(folder.path() / "rig.yaml", to_yaml(read_rig(rig)));
  folder.commit();
  journal.remove();
  const Json json = {{"written", out},           {"keyframes", recovered.keyframes}, {"frames", recovered.frames},
                     {"links", recovered.links}, {"damaged", recovered.damaged},     {"others", left.size() - 1}};
  std::string line = "restored: " + std::to_string(recovered.keyframes) + " keyframes, " +
                     std::to_string(recovered.frames) + " frames and " + std::to_string(recovered.links) + " links";
  if (recovered.damaged > 0) line += "; " + std::to_string(recovered.damaged) + " more are damaged";
  print_result(common, json, line + "\nwritten: " + out + "/" + kMapFile);
  report_left_maps(run);
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
  const Command info_verb = group.add_subcommand("info", "Print the contents of a saved map");
  auto of_info = std::make_shared<InfoArguments>();
  info_verb.add_option("map", of_info->map, "Run folder with saved.map, or a map file").required();
  info_verb.add_flag("--verify", of_info->verify, "Also compare all images and landmarks with their checksums");
  const Command recover_verb =
      group.add_subcommand("recover", "Restore the map of a run with --save-map that was killed or lost power");
  auto of_recover = std::make_shared<RecoverArguments>();
  recover_verb.add_option("run", of_recover->run, "Run folder that the run would have written").required();
  recover_verb.add_option("--out", of_recover->out, "Folder to write: saved.map, rig.yaml (default: RUN.recovered)");
  return [=, &common] {
    if (info_verb.parsed()) return info(*of_info, common);
    if (recover_verb.parsed()) return recover(*of_recover, common);
    return merge(*arguments, common);
  };
}

}  // namespace fringeslam::tools
