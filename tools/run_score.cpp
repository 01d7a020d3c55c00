// SPDX-License-Identifier: Apache-2.0
#include "tools/run_score.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/base/parallel.h"
#include "core/depth/depth.h"
#include "core/io/files.h"
#include "core/io/tum_file.h"
#include "core/io/yaml.h"
#include "core/patterns/patterns.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/score/truth_files.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

// Returns 0 for values that would be printed as -0.000.
double no_minus_zero(double value, int digits) { return std::abs(value) < 0.5 * std::pow(10.0, -digits) ? 0.0 : value; }

nlohmann::ordered_json to_json(const SixDof& six) {
  return {six.translation_mm.x(), six.translation_mm.y(), six.translation_mm.z(),
          six.angles_deg.x(),     six.angles_deg.y(),     six.angles_deg.z()};
}

nlohmann::ordered_json to_json(const ErrorStatistics& s) {
  return {{"rmse", s.rmse}, {"mean", s.mean}, {"median", s.median}, {"std", s.std},
          {"min", s.min},   {"max", s.max},   {"sse", s.sse}};
}

// Formats one row of the statistics table; `per_unit` converts to the printed unit.
std::string statistics_line(const char* label, const ErrorStatistics& s, double per_unit) {
  std::string line = format("%-18s", label);
  for (const double value : {s.rmse, s.mean, s.median, s.std, s.min, s.max}) line += format("%12.6g", value * per_unit);
  return line + format("%12.6g\n", s.sse * per_unit * per_unit);
}

// One view of a run with its ground truth.
struct View {
  DepthEstimate estimate;
  TruthFrame truth;
};

// Where the files of a run and of its ground truth are.
struct ScoredFolders {
  fs::path run, truth;
};

View read_view(const ScoredFolders& folders, const Pinhole& camera, int index) {
  return {read_depth_estimate(folders.run / "frames" / stack_name(index) / "depth.exr", &camera),
          read_truth_frame(folders.truth / (stack_name(index) + ".exr"), &camera)};
}

// Reads the victims found by the run, in the map's world frame.
std::vector<VictimCandidate> read_victims(const fs::path& file) {
  const auto json = nlohmann::json::parse(read_bytes(file), nullptr, false);
  std::vector<VictimCandidate> victims;
  const auto other = [&] { return Error(file.string() + ":1: does not have the format written by a run"); };
  if (!json.is_array()) throw other();
  try {
    for (const auto& thing : json) {
      if (!thing.at("victim").get<bool>()) continue;
      VictimCandidate& points_m = victims.emplace_back();
      for (const auto& p : thing.at("points_m"))
        points_m.emplace_back(p.at(0).get<double>(), p.at(1).get<double>(), p.at(2).get<double>());
    }
  } catch (const nlohmann::json::exception&) {
    throw other();
  }
  return victims;
}

struct AssociatedPoses {
  const Trajectory &estimate, &truth;
  const std::vector<std::pair<size_t, size_t>>& pairs;  // indices of a view's two poses
};

// Scores depth and motion of all views. Reading them takes most of the time, so blocks of views are scored
// concurrently; each block reads its predecessor's last view again.
void score_views(const ScoredFolders& folders, const RigModel& rig, const AssociatedPoses& poses,
                 const ScoreObserver& observer, RunScore& score, VisibleVictims& visible) {
  constexpr size_t kBlock = 16;
  const auto& [estimate, truth, pairs] = poses;
  const size_t views = pairs.size();
  const double period = finest_period_px(read_patterns(folders.run / "patterns.yaml"));
  const PixelRays rays = pixel_rays(rig.camera);
  const Pose camera_from_robot = rig.robot_from_camera.inverse();
  score.frames.resize(views);
  score.pairs.resize(views > 0 ? views - 1 : 0);
  std::mutex mutex;
  size_t done = 0;  // guarded by mutex
  const auto index_of = [&](size_t k) { return static_cast<int>(pairs[k].second); };
  const auto score_block = [&](int block) {
    const size_t first = static_cast<size_t>(block) * kBlock, end = std::min(views, first + kBlock);
    View previous = first > 0 ? read_view(folders, rig.camera, index_of(first - 1)) : View();
    for (size_t k = first; k < end; ++k) {
      const auto [i, j] = pairs[k];
      View current = read_view(folders, rig.camera, index_of(k));
      score.frames[k] = {index_of(k), score_depth(current.estimate, current.truth, period)};
      if (k > 0) {
        const auto [last_i, last_j] = pairs[k - 1];
        const Pose true_motion = truth[last_j].world_from_robot.inverse() * truth[j].world_from_robot;
        const Pose motion = estimate[last_i].world_from_robot.inverse() * estimate[i].world_from_robot;
        const Pose true_camera_motion = camera_from_robot * true_motion * rig.robot_from_camera;
        const Pose camera_motion = camera_from_robot * motion * rig.robot_from_camera;
        const Matrix6d information = pose_information(previous.truth, previous.estimate.sigma_m, current.truth,
                                                      current.estimate.sigma_m, rig.camera, rays, true_camera_motion);
        score.pairs[k - 1] = {index_of(k - 1), index_of(k), score_motion(motion, true_motion),
                              error_over_bound(camera_motion, true_camera_motion, information)};
      }
      if (observer.view) observer.view(index_of(k), current.estimate, current.truth);
      const std::lock_guard lock(mutex);
      if (rig.thermal) visible.add(current.truth, rig.camera, truth[j].world_from_robot * rig.robot_from_camera);
      if (observer.progress) observer.progress(++done, views);
      previous = std::move(current);
    }
  };
  for_each_row(static_cast<int>((views + kBlock - 1) / kBlock), score_block);
  if (!rig.thermal) return;
  // Victims that only views without a pose show count as not found.
  std::vector<bool> has_pose(truth.size());
  for (const auto& [i, j] : pairs) has_pose[j] = true;
  for (size_t j = 0; j < std::min(truth.size(), static_cast<size_t>(score.stacks)); ++j) {
    const fs::path file = folders.truth / (stack_name(static_cast<int>(j)) + ".exr");
    if (!has_pose[j] && fs::exists(file))
      visible.add(read_truth_frame(file, &rig.camera), rig.camera, truth[j].world_from_robot * rig.robot_from_camera);
  }
}

}  // namespace

RunScore score_run(const fs::path& folder, const TrajectoryOptions& options, const ScoreObserver& observer,
                   fs::path truth_folder) {
  if (truth_folder.empty()) truth_folder = folder / "truth";
  RunScore score;
  const YamlMap config = YamlMap::load(folder / "config.yaml");
  score.name = config.text("name");
  score.seed = config.seed("seed");
  score.stacks = config.integer("stacks", {1, 1e6});
  const RigModel rig = read_rig(folder / "rig.yaml");
  const Trajectory truth = read_tum(truth_folder / "truth.tum");
  const Trajectory estimate = read_tum(folder / "trajectory.tum");
  const auto pairs = associate(estimate, truth, options.max_gap_s);
  if (pairs.size() < estimate.size()) {
    const auto lacks_truth = [&](size_t i) {
      return std::none_of(pairs.begin(), pairs.end(), [&](const auto& pair) { return pair.first == i; });
    };
    size_t first = 0;
    while (!lacks_truth(first)) ++first;
    throw Error((truth_folder / "truth.tum").string() + ": has no pose at " + to_text(estimate[first].timestamp_s) +
                " s, the time of a view of trajectory.tum; the ground truth is of another recording");
  }
  score.tracked = static_cast<int>(estimate.size());
  VisibleVictims visible;
  score_views({folder, truth_folder}, rig, {estimate, truth, pairs}, observer, score, visible);
  if (rig.thermal && !pairs.empty()) {
    const auto [i, j] = pairs.front();
    const Pose truth_from_map = truth[j].world_from_robot * estimate[i].world_from_robot.inverse();
    std::vector<VictimCandidate> candidates = read_victims(folder / "victims.json");
    for (VictimCandidate& candidate : candidates) {
      for (Eigen::Vector3d& point_m : candidate) point_m = truth_from_map * point_m;
    }
    score.victims = score_victims(visible, candidates);
  }
  const fs::path images = folder / "images.tum", exposures = truth_folder / "exposures.tum";
  if (!pairs.empty() && fs::exists(images) && fs::file_size(images) > 0 && fs::exists(exposures)) {
    // Aligned by the first view, like the trajectory of the views.
    const auto [i, j] = pairs.front();
    const Pose truth_from_map = truth[j].world_from_robot * estimate[i].world_from_robot.inverse();
    Trajectory poses = read_tum(images);
    for (TimedPose& pose : poses) pose.world_from_robot = truth_from_map * pose.world_from_robot;
    const Trajectory true_poses = read_tum(exposures);
    TrajectoryOptions aligned = options;
    aligned.align = Alignment::none;
    if (associate(poses, true_poses, aligned.max_gap_s).size() >= 2) {
      score.images = score_trajectory(poses, true_poses, aligned);
      // Alignment by the first image would turn all others by the error of its rotation.
      aligned.relation = PoseRelation::translation;
      score.images->ate_rmse_m = score_trajectory(poses, true_poses, aligned).ape.rmse;
    }
  }
  if (pairs.size() >= 2) score.trajectory = score_trajectory(estimate, truth, options);
  return score;
}

nlohmann::ordered_json to_json(const TrajectoryScore& score) {
  return {{"poses", score.poses},
          {"ate_rmse_mm", score.ate_rmse_m * 1e3},
          {"ate_umeyama_rmse_mm", score.ate_umeyama_rmse_m * 1e3},
          {"rpe_translation_rmse_mm", score.rpe_translation_rmse_m * 1e3},
          {"rpe_rotation_rmse_deg", score.rpe_rotation_rmse_rad * kDegPerRad},
          {"align", to_string(score.options.align)},
          {"scale", score.truth_from_estimate.scale},
          {"relation", to_string(score.options.relation)},
          {score.options.relation == PoseRelation::translation ? "ape_m" : "ape", to_json(score.ape)},
          {"delta", score.options.delta},
          {"all_pairs", score.options.all_pairs},
          {"steps", score.steps},
          {"rpe_translation_m", to_json(score.rpe_translation_m)},
          {"rpe_rotation_deg", to_json(score.rpe_rotation_deg)}};
}

nlohmann::ordered_json to_json(const RunScore& score) {
  nlohmann::ordered_json json;
  json["name"] = score.name;
  json["seed"] = score.seed;
  json["stacks"] = score.stacks;
  json["tracked"] = score.tracked;
  json["convention"] = "previous_from_current of the robot: X Y Z in mm, alpha beta gamma in degrees, R = Rz Ry Rx";
  for (const PairScore& pair : score.pairs) {
    json["pairs"].push_back({{"previous", pair.previous},
                             {"current", pair.current},
                             {"true", to_json(pair.motion.truth)},
                             {"estimated", to_json(pair.motion.estimate)},
                             {"error", to_json(pair.motion.error)},
                             {"translation_error_mm", pair.motion.translation_error_m * 1e3},
                             {"rotation_error_deg", pair.motion.rotation_error_rad * kDegPerRad},
                             {"error_over_bound", pair.error_over_bound}});
  }
  for (const FrameScore& frame : score.frames) {
    json["frames"].push_back({{"index", frame.index},
                              {"compared", frame.depth.compared},
                              {"depth_median_mm", frame.depth.median_m * 1e3},
                              {"depth_rms_mm", frame.depth.rms_m * 1e3},
                              {"depth_p99_mm", frame.depth.p99_m * 1e3},
                              {"valid_fraction", frame.depth.valid_fraction},
                              {"wrong_order", frame.depth.wrong_order},
                              {"spurious", frame.depth.spurious}});
  }
  if (score.trajectory) json["trajectory"] = to_json(*score.trajectory);
  if (score.images) json["images"] = to_json(*score.images);
  if (score.victims)
    json["victims"] = {{"to_find", score.victims->to_find}, {"found", score.victims->found},
                       {"recall", score.victims->recall()}, {"candidates", score.victims->candidates},
                       {"right", score.victims->right},     {"precision", score.victims->precision()}};
  return json;
}

std::string to_table(const TrajectoryScore& score) {
  return format("trajectory of %d poses: ATE %.4f mm (best alignment %.4f mm), RPE %.4f mm, %.5f deg\n", score.poses,
                score.ate_rmse_m * 1e3, score.ate_umeyama_rmse_m * 1e3, score.rpe_translation_rmse_m * 1e3,
                score.rpe_rotation_rmse_rad * kDegPerRad);
}

std::string statistics_table(const TrajectoryScore& score) {
  const TrajectoryOptions& options = score.options;
  std::string text = std::string("\naligned by ") + to_string(options.align);
  if (options.align == Alignment::sim3) text += format(", scale %.9g", score.truth_from_estimate.scale);
  text += format("; %d steps of %d frame%s\n", score.steps, options.delta, options.delta == 1 ? "" : "s");
  text += "                          rmse        mean      median         std         min         max         sse\n";
  const bool length = options.relation == PoseRelation::translation;
  text += statistics_line(length                                           ? "APE mm"
                          : options.relation == PoseRelation::rotation_deg ? "APE deg"
                                                                           : "APE full",
                          score.ape, length ? 1e3 : 1);
  return text + statistics_line("RPE mm", score.rpe_translation_m, 1e3) +
         statistics_line("RPE deg", score.rpe_rotation_deg, 1);
}

std::string to_table(const RunScore& score) {
  std::string text = format("%s, seed %llu: %d of %d views tracked\n\n", single_line(score.name).c_str(),
                            static_cast<unsigned long long>(score.seed), score.tracked, score.stacks);
  if (!score.pairs.empty())
    text +=
        "motion (previous from current)      dX mm     dY mm     dZ mm    da deg    db deg    dg deg   error/bound\n";
  for (const PairScore& pair : score.pairs) {
    const auto line = [&](const char* label, const SixDof& six, int digits) {
      std::string row = format("  %d -> %d  %-20s", pair.previous, pair.current, label);
      for (int i = 0; i < 3; ++i) row += format("%10.*f", digits, no_minus_zero(six.translation_mm[i], digits));
      const int angle_digits = digits + (digits > 3 ? 1 : 0);
      for (int i = 0; i < 3; ++i) row += format("%10.*f", angle_digits, no_minus_zero(six.angles_deg[i], angle_digits));
      return row;
    };
    text += line("true", pair.motion.truth, 3) + "\n";
    text += line("estimated", pair.motion.estimate, 3) + "\n";
    text += line("error", pair.motion.error, 4) + format("%11.2f\n", pair.error_over_bound);
  }
  text += "\ndepth error mm      median       RMS      99 %   valid %   wrong order\n";
  for (const FrameScore& frame : score.frames) {
    const DepthScore& d = frame.depth;
    text += format("  view %-11d %9.4f %9.4f %9.4f %9.2f %13.1e\n", frame.index, d.median_m * 1e3, d.rms_m * 1e3,
                   d.p99_m * 1e3, d.valid_fraction * 100, d.wrong_order);
  }
  if (score.victims)
    text += format("\nvictims: %d of %d found; %d of %d candidates correct\n", score.victims->found,
                   score.victims->to_find, score.victims->right, score.victims->candidates);
  if (!score.trajectory) return text + "\nno motion was estimated\n";
  text += "\n" + to_table(*score.trajectory);
  if (score.images)
    text += format("poses of %d single images: ATE %.4f mm, RPE %.4f mm, %.5f deg\n", score.images->poses,
                   score.images->ate_rmse_m * 1e3, score.images->rpe_translation_rmse_m * 1e3,
                   score.images->rpe_rotation_rmse_rad * kDegPerRad);
  return text;
}

}  // namespace fringeslam::tools
