// SPDX-License-Identifier: Apache-2.0
// fringeslam score RUN | TRAJECTORY --truth TRUTH | MAP.ply --truth TRUTH
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"
#include "core/score/trajectory_file.h"
#include "core/types/error.h"
#include "tools/map_truth.h"
#include "tools/run_score.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct ScoreArguments {
  std::string estimate, truth, trajectory;
  TrajectoryOptions options;
  double threshold_m = 1e-3;
  std::optional<uint64_t> seed;
};

void print(const Common& common, const nlohmann::ordered_json& json, const std::string& table) {
  std::fputs(common.json ? (json_text(json, 2) + "\n").c_str() : table.c_str(), stdout);
}

void score_run_folder(const ScoreArguments& arguments, bool with_statistics, const Common& common) {
  const fs::path folder = arguments.estimate;
  if (!fs::exists(folder / "truth" / "truth.tum"))
    throw Error(folder.string() + ": contains no truth/truth.tum, so it cannot be scored");
  if (!arguments.truth.empty())
    throw Error("score: a run folder is scored against its own ground truth; leave out --truth");
  const RunScore score = score_run(folder, arguments.options);
  print(common, tools::to_json(score),
        to_table(score) + (with_statistics && score.trajectory ? statistics_table(*score.trajectory) : std::string()));
}

// Names both files in errors that neither of them has by itself, such as times that do not match.
TrajectoryScore score_of_files(const ScoreArguments& arguments) {
  const Trajectory estimate = read_trajectory(arguments.estimate), truth = true_trajectory(arguments.truth);
  try {
    return score_trajectory(estimate, truth, arguments.options);
  } catch (const Error& e) {
    throw Error(arguments.estimate + " with --truth " + arguments.truth + ": " + e.what());
  }
}

void score_trajectory_file(const ScoreArguments& arguments, const Common& common) {
  const TrajectoryScore score = score_of_files(arguments);
  print(common, tools::to_json(score), to_table(score) + statistics_table(score));
}

nlohmann::ordered_json distances_json(const DistanceStatistics& s) {
  return {{"points", s.points},
          {"mean", s.mean_m * 1e3},
          {"median", s.median_m * 1e3},
          {"p90", s.p90_m * 1e3},
          {"rms", s.rms_m * 1e3}};
}

std::string line(const char* label, const DistanceStatistics& s, double share) {
  char text[256];
  std::snprintf(text, sizeof text, "%-30s%12zu%10.4f%10.4f%10.4f%10.4f%10.4f\n", label, s.points, s.mean_m * 1e3,
                s.median_m * 1e3, s.p90_m * 1e3, s.rms_m * 1e3, share);
  return text;
}

std::string map_table(const MapScore& score, const PlyMap& map, const std::string& aligned) {
  char text[256];
  std::snprintf(
      text, sizeof text, "map of %zu vertices, %zu triangles; %s\n%sdistances in mm%42s%10s%10s%10s%10s\n",
      map.vertices.size(), map.triangles.size(), aligned.c_str(),
      map.dropped > 0 ? (std::to_string(map.dropped) + " vertices are not finite and were ignored\n").c_str() : "",
      "points      mean", "median", "90 %", "RMS", "within");
  std::string table = text + line("accuracy: map to surface", score.accuracy, score.precision) +
                      line("completeness: surface to map", score.completeness, score.recall);
  std::snprintf(text, sizeof text, "F-score at %g mm: %.4f\n", score.threshold_m * 1e3, score.f_score());
  return table + text;
}

void score_map_file(const ScoreArguments& arguments, const Common& common) {
  PlyMap map = read_ply(arguments.estimate);
  if (map.vertices.empty()) throw Error(arguments.estimate + ": contains no finite vertex");
  const MapTruth truth = read_map_truth(arguments.truth, arguments.seed, common);
  Similarity world_from_map;
  std::string aligned = "not aligned";
  if (!arguments.trajectory.empty()) {
    world_from_map = align_trajectory(read_trajectory(arguments.trajectory), truth.trajectory, arguments.options);
    aligned = std::string("aligned by its trajectory: ") + to_string(arguments.options.align);
    if (arguments.options.align == Alignment::sim3) aligned += ", scale " + to_text(world_from_map.scale);
    for (Eigen::Vector3d& vertex : map.vertices) vertex = world_from_map * vertex;
  }
  const MapScore score = score_map(map, truth, arguments.threshold_m);
  const nlohmann::ordered_json json = {
      {"scene", truth.name},
      {"vertices", map.vertices.size()},
      {"triangles", map.triangles.size()},
      {"dropped", map.dropped},
      {"align", to_string(arguments.trajectory.empty() ? Alignment::none : arguments.options.align)},
      {"scale", world_from_map.scale},
      {"accuracy_mm", distances_json(score.accuracy)},
      {"completeness_mm", distances_json(score.completeness)},
      {"threshold_mm", score.threshold_m * 1e3},
      {"precision", score.precision},
      {"recall", score.recall},
      {"f_score", score.f_score()}};
  print(common, json, map_table(score, map, aligned));
}

}  // namespace

Verb add_score(Command app, const Common& common) {
  auto arguments = std::make_shared<ScoreArguments>();
  TrajectoryOptions& options = arguments->options;
  const Command verb =
      app.add_subcommand("score", "Score a run, or any system's trajectory or map, against ground truth");
  verb.add_option("estimate", arguments->estimate, "Run folder, trajectory (TUM or EuRoC), or map (PLY)").required();
  verb.add_option(
      "--truth", arguments->truth,
      "Ground truth. For a trajectory: the true trajectory or a rendered folder or bag; for a map: scene, dataset, run "
      "or TUM RGB-D or EuRoC folder; not for a run folder, which contains its own");
  const Option align =
      add_choice(verb, "--align", options.align,
                 "Alignment: none, origin (first pose), se3 or sim3 (all positions, sim3 with scale); evo's "
                 "--align_origin, --align, --align --correct_scale")
          .default_str(to_string(options.align));
  const std::vector<Option> of_trajectory = {
      add_choice(verb, "--relation", options.relation, "Part of the pose compared by the APE")
          .default_str(to_string(options.relation)),
      verb.add_option("--delta", options.delta, "Number of frames between the poses of the RPE")
          .check_range(1, 1000000000)
          .capture_default_str(),
      verb.add_flag("--all-pairs", options.all_pairs, "RPE from every frame instead of every delta-th frame")};
  const Option max_gap =
      verb.add_option("--max-gap", options.max_gap_s, "Largest timestamp difference between associated poses, s")
          .check_range(0.0, 1e9)
          .capture_default_str();
  const std::vector<Option> of_map = {
      verb.add_option("--threshold", arguments->threshold_m, "Map: largest distance that counts as correct, m")
          .check_range(1e-9, 1e9)
          .capture_default_str(),
      verb.add_option("--trajectory", arguments->trajectory,
                      "Map: the system's trajectory; --align aligns it, and the map with it, to the true trajectory"),
      verb.add_option("--seed", arguments->seed, "Map: seed of the true scene; overrides the scene's")
          .check_non_negative()};
  return [arguments, align, of_trajectory, max_gap, of_map, &common] {
    const bool is_run = fs::is_directory(arguments->estimate), is_map = !is_run && is_ply(arguments->estimate);
    for (const Option& option : is_map ? of_trajectory : of_map) {
      if (option.count() > 0)
        throw Error("score: " + option.get_name() + " has no effect on a " + (is_map ? "map" : "trajectory"));
    }
    // The table of a run leaves out what these options change.
    const bool shapes_statistics = align.count() > 0 || max_gap.count() > 0 ||
                                   std::any_of(of_trajectory.begin(), of_trajectory.end(),
                                               [](const Option& option) { return option.count() > 0; });
    if (!is_run && arguments->truth.empty())
      throw Error(std::string("score: a ") + (is_map ? "map needs its true surface: add --truth SCENE"
                                                     : "trajectory needs a true trajectory: add --truth FILE"));
    if (is_map && align.count() > 0 && arguments->options.align != Alignment::none && arguments->trajectory.empty())
      throw Error("score: a map is aligned by its system's trajectory: add --trajectory FILE");
    if (is_map && max_gap.count() > 0 && arguments->trajectory.empty())
      throw Error("score: --max-gap has no effect on a map without --trajectory");
    if (is_run)
      score_run_folder(*arguments, shapes_statistics, common);
    else if (is_map)
      score_map_file(*arguments, common);
    else
      score_trajectory_file(*arguments, common);
    return 0;
  };
}

}  // namespace fringeslam::tools
