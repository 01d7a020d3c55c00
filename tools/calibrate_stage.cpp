// SPDX-License-Identifier: Apache-2.0
// fringeslam calibrate stage DATASET --out FOLDER
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/calibrate/board.h"
#include "core/calibrate/stage.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/setting_groups.h"
#include "core/io/tum_file.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/types/trajectory.h"
#include "tools/board_file.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct StageSettings {
  DecodeOptions decode;
  DepthOptions depth;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("decode", decode);
    visit("depth", depth);
  }
};

struct CalibrateStageArguments {
  std::string dataset, board, poses, out;
  std::vector<std::string> sets;
};

// Returns the radius of the plane fits in px: 80 % of the mean corner spacing, from 3 to 40.
double fit_radius(const std::vector<cv::Point2f>& corners, const Board& board) {
  const auto last = corners.size() - 1;
  const double diagonal = cv::norm(corners[last] - corners[0]);
  return std::clamp(0.8 * diagonal / std::hypot(board.columns - 1, board.rows - 1), 3.0, 40.0);
}

StageView look(const Frame& frame, const cv::Mat1f& texture, const RigModel& rig, const Board& board, const Pose& pose,
               std::vector<cv::Point2f>& last_corners) {
  StageView view{pose, {}};
  std::vector<cv::Point2f> corners = detect_board(texture, board);
  if (!is_complete(corners)) corners.clear();
  if (corners.empty()) return view;
  align_corner_order(last_corners, corners);
  last_corners = corners;
  for (const cv::Point2f& corner : corners)
    view.corners.push_back(corner_point(frame, rig.camera, {corner.x, corner.y}, fit_radius(corners, board)));
  return view;
}

std::string to_table(const StageCalibration& c) {
  char line[256];
  std::string text;
  const auto pose_line = [&](const char* name, const Pose& pose) {
    const SixDof six = six_dof(pose);
    const Eigen::Vector3d &t = six.translation_mm, &a = six.angles_deg;
    std::snprintf(line, sizeof line, "%-22s %10.4f %10.4f %10.4f mm  %9.5f %9.5f %9.5f deg\n", name, t.x(), t.y(),
                  t.z(), a.x(), a.y(), a.z());
    text += line;
  };
  text += "robot_from_camera from " + std::to_string(c.motions) + " motions and " + std::to_string(c.corners) +
          " corners\n";
  pose_line("affine, made rigid", c.nearest_rigid);
  pose_line("maximum likelihood", c.robot_from_camera);
  const Vector6d s = c.covariance.diagonal().cwiseSqrt();
  const double degrees = 180 / std::numbers::pi;
  std::snprintf(line, sizeof line, "%-22s %10.4f %10.4f %10.4f mm  %9.5f %9.5f %9.5f deg (about the robot's axes)\n",
                "sigma", 1e3 * s(3), 1e3 * s(4), 1e3 * s(5), degrees * s(0), degrees * s(1), degrees * s(2));
  text += line;
  std::snprintf(line, sizeof line,
                "residuals %.4f mm RMS; the affine estimate deviates from a rigid transform by %.1e\n", 1e3 * c.rms_m,
                c.affinity);
  return text + line;
}

nlohmann::ordered_json to_json(const StageCalibration& c) {
  const SixDof six = six_dof(c.robot_from_camera);
  const auto list = [](const auto& v) { return std::vector<double>(v.begin(), v.end()); };
  nlohmann::ordered_json json = {{"motions", c.motions},
                                 {"corners", c.corners},
                                 {"translation_mm", list(six.translation_mm)},
                                 {"rotation_deg", list(six.angles_deg)},
                                 {"rms_mm", 1e3 * c.rms_m},
                                 {"affinity", c.affinity}};
  for (int row = 0; row < 3; ++row) json["affine"].push_back(list(Eigen::Vector4d(c.affine.row(row).transpose())));
  for (int row = 0; row < 6; ++row) json["covariance"].push_back(list(Vector6d(c.covariance.row(row).transpose())));
  return json;
}

int calibrate(const CalibrateStageArguments& arguments, const Common& common) {
  StageSettings settings;
  apply_settings(settings, arguments.sets);
  ReplayRig replay(arguments.dataset);
  if (!replay.model().calibrated)
    throw Error(arguments.dataset + ": its rig is not calibrated; run fringeslam calibrate rig first");
  const Board board = board_of(arguments.dataset, arguments.board);
  const fs::path pose_file =
      arguments.poses.empty() ? fs::path(arguments.dataset) / kStageFile : fs::path(arguments.poses);
  if (!fs::exists(pose_file))
    throw Error(pose_file.string() +
                ": is missing; give the commanded poses world_from_robot by --poses FILE (TUM format)");
  const Trajectory poses = read_tum(pose_file);
  if (static_cast<int>(poses.size()) != replay.info().stacks)
    throw Error(pose_file.string() + ": has " + std::to_string(poses.size()) + " poses but the dataset has " +
                std::to_string(replay.info().stacks) + " stacks");
  RigModel rig = replay.model();
  const PixelRays rays = pixel_rays(rig.camera);
  const Triangulation triangulation(rig, rays, settings.depth.near_m, settings.depth.far_m);
  require_not_an_input(arguments.out, {arguments.dataset, arguments.board, pose_file});
  StagedFolder folder(arguments.out, "stage calibration");
  std::vector<StageView> views;
  std::vector<cv::Point2f> last_corners;
  std::string lost;
  {
    Progress progress("finding boards", replay.info().stacks, common.quiet || common.json);
    while (const auto stack = replay.capture(replay.sequence())) {
      const DecodedStack decoded = decode(*stack, rig, settings.decode);
      Frame frame;
      triangulate(frame, decoded, triangulation, settings.depth);
      StageView view = look(frame, decoded.mean, rig, board, poses[static_cast<size_t>(stack->index)].world_from_robot,
                            last_corners);
      if (view.corners.empty())
        lost += (lost.empty() ? "" : ", ") + std::to_string(stack->index);
      else
        views.push_back(std::move(view));
      progress.step();
    }
  }
  StageCalibration calibration;
  try {
    calibration = calibrate_stage(views);
  } catch (const Error& e) {
    throw Error(arguments.dataset + ": " + e.what() + (lost.empty() ? "" : " (no board found in views " + lost + ")"));
  }
  rig.robot_from_camera = calibration.robot_from_camera;
  write_text(folder.path() / "rig.yaml", to_yaml(rig));
  write_text(folder.path() / "stage.json", json_text(to_json(calibration), 2) + "\n");
  folder.commit();
  if (common.json) {
    std::printf("%s\n", json_text(to_json(calibration), 2).c_str());
  } else {
    if (!lost.empty()) std::printf("no board found in views %s\n", lost.c_str());
    std::printf("%s\nwritten: %s  (rig.yaml, stage.json)\n", to_table(calibration).c_str(), arguments.out.c_str());
  }
  return 0;
}

}  // namespace

Verb add_calibrate_stage(Command group, const Common& common) {
  auto arguments = std::make_shared<CalibrateStageArguments>();
  const Command verb = group.add_subcommand(
      "stage", "Pose of the sensor on its stage or robot, from a board seen during commanded motions");
  verb.add_option("dataset", arguments->dataset, "Dataset of a stationary board, one stack per pose").required();
  verb.add_option("--board", arguments->board, "Board file (default: DATASET/board.yaml)");
  verb.add_option("--poses", arguments->poses,
                  "Commanded poses world_from_robot, TUM format (default: DATASET/stage.tum)");
  verb.add_option("--out", arguments->out, "Folder for rig.yaml and stage.json").required();
  verb.add_option("--set", arguments->sets, "decode.key=value or depth.key=value (repeatable; listed below)");
  verb.footer(groups_help(StageSettings()));
  return [arguments, &common] { return calibrate(*arguments, common); };
}

}  // namespace fringeslam::tools
