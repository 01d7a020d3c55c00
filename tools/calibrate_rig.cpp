// SPDX-License-Identifier: Apache-2.0
// fringeslam calibrate rig DATASET --out FOLDER
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/calibrate/rig_calibration.h"
#include "core/decode/decode.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/setting_groups.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tools/board_file.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/report/calibration_page.h"
#include "tools/report/coverage.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct CalibrationSettings {
  RigCalibrationOptions calibration;
  DecodeOptions decode;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("calibration", calibration);
    visit("decode", decode);
  }
};

struct CalibrateRigArguments {
  std::string dataset, board, out;
  std::vector<std::string> sets;
};

BoardView observe(const FringeStack& stack, const RigModel& rig, const Board& board,
                  const CalibrationSettings& settings, cv::Mat1f& texture) {
  const DecodedStack columns = decode(stack, rig, settings.decode, {Axis::columns});
  const DecodedStack rows = decode(stack, rig, settings.decode, {Axis::rows});
  cv::addWeighted(columns.mean, 0.5, rows.mean, 0.5, 0, texture);
  return observe_board("view " + std::to_string(stack.index), texture,
                       {columns.coordinate_px, rows.coordinate_px, columns.sigma_px, rows.sigma_px}, board,
                       settings.calibration);
}

std::string parameter_lines(const std::string& device, const Pinhole& lens, const LensSigmas& sigma) {
  char line[256];
  std::string text;
  std::snprintf(line, sizeof line, "%-10s fx %.2f ± %.2f  fy %.2f ± %.2f  cx %.2f ± %.2f  cy %.2f ± %.2f px\n",
                device.c_str(), lens.fx, sigma.fx, lens.fy, sigma.fy, lens.cx, sigma.cx, lens.cy, sigma.cy);
  text += line;
  const Distortion &d = lens.distortion, &s = sigma.distortion;
  std::snprintf(line, sizeof line,
                "%-10s k1 %.4f ± %.4f  k2 %.4f ± %.4f  p1 %.5f ± %.5f  p2 %.5f ± %.5f  k3 %.4f ± %.4f\n", "", d.k1,
                s.k1, d.k2, s.k2, d.p1, s.p1, d.p2, s.p2, d.k3, s.k3);
  return text + line;
}

std::string to_table(const RigCalibration& c) {
  std::string text = "view            camera px  projector px\n";
  char line[256];
  for (const ViewResult& view : c.views) {
    if (view.used)
      std::snprintf(line, sizeof line, "%-14s %10.4f %13.4f\n", view.name.c_str(), view.camera_rms_px,
                    view.projector_rms_px);
    else
      std::snprintf(line, sizeof line, "%-14s not used: %s\n", view.name.c_str(), view.reason.c_str());
    text += line;
  }
  std::snprintf(line, sizeof line, "%-14s %10.4f %13.4f  (RMS reprojection)\n\n", "all", c.camera_rms_px,
                c.projector_rms_px);
  text += line;
  text += "board measured with the rig from the others:  plane RMS mm   scale error %\n";
  for (const HeldOutBoard& board : c.held_out) {
    std::snprintf(line, sizeof line, "%-45s %13.3f %15.3f\n", board.name.c_str(), 1e3 * board.plane_rms_m,
                  100 * board.scale_error);
    text += line;
  }
  std::snprintf(line, sizeof line,
                "corners cover %.0f %% of the camera's and %.0f %% of the projector's image; the boards disagree by "
                "%.1f times the noise of their corners\n\n",
                100 * c.camera_coverage, 100 * c.projector_coverage, c.covariance_factor);
  text += line;
  text += parameter_lines("camera", c.rig.camera, c.camera_sigma);
  text += parameter_lines("projector", c.rig.projector, c.projector_sigma);
  const SixDof pose = six_dof(c.rig.projector_from_camera);
  const Eigen::Vector3d t = 1e3 * c.translation_sigma_m, r = c.rotation_sigma_rad * 180 / std::numbers::pi;
  std::snprintf(
      line, sizeof line,
      "projector_from_camera  %.3f ± %.3f  %.3f ± %.3f  %.3f ± %.3f mm;  %.4f ± %.4f  %.4f ± %.4f  %.4f ± %.4f deg\n",
      pose.translation_mm.x(), t.x(), pose.translation_mm.y(), t.y(), pose.translation_mm.z(), t.z(),
      pose.angles_deg.x(), r.x(), pose.angles_deg.y(), r.y(), pose.angles_deg.z(), r.z());
  return text + line;
}

nlohmann::ordered_json to_json(const Pinhole& p, const LensSigmas& s, double rms_px) {
  const Distortion &d = p.distortion, &e = s.distortion;
  return {{"rms_px", rms_px},
          {"fx_px", p.fx},
          {"fy_px", p.fy},
          {"cx_px", p.cx},
          {"cy_px", p.cy},
          {"distortion", {d.k1, d.k2, d.p1, d.p2, d.k3}},
          {"sigma_px", {s.fx, s.fy, s.cx, s.cy}},
          {"sigma_distortion", {e.k1, e.k2, e.p1, e.p2, e.k3}}};
}

nlohmann::ordered_json to_json(const RigCalibration& c) {
  nlohmann::ordered_json json;
  json["camera"] = to_json(c.rig.camera, c.camera_sigma, c.camera_rms_px);
  json["projector"] = to_json(c.rig.projector, c.projector_sigma, c.projector_rms_px);
  const SixDof pose = six_dof(c.rig.projector_from_camera);
  const auto list = [](const Eigen::Vector3d& v) { return std::vector<double>{v.x(), v.y(), v.z()}; };
  json["projector_from_camera"] = {{"translation_mm", list(pose.translation_mm)},
                                   {"rotation_deg", list(pose.angles_deg)},
                                   {"sigma_translation_mm", list(1e3 * c.translation_sigma_m)},
                                   {"sigma_rotation_deg", list(c.rotation_sigma_rad * 180 / std::numbers::pi)}};
  for (Eigen::Index row = 0; row < c.covariance.rows(); ++row) {
    const Eigen::VectorXd values = c.covariance.row(row);
    json["covariance"].push_back(std::vector<double>(values.begin(), values.end()));
  }
  json["covariance_factor"] = c.covariance_factor;
  json["coverage"] = {{"camera", c.camera_coverage}, {"projector", c.projector_coverage}};
  json["warnings"] = c.warnings;
  for (const HeldOutBoard& board : c.held_out)
    json["held_out"].push_back(
        {{"name", board.name}, {"plane_rms_mm", 1e3 * board.plane_rms_m}, {"scale_error", board.scale_error}});
  for (const ViewResult& view : c.views) {
    nlohmann::ordered_json entry = {{"name", view.name}, {"used", view.used}};
    if (view.used) {
      entry["camera_rms_px"] = view.camera_rms_px;
      entry["projector_rms_px"] = view.projector_rms_px;
    } else {
      entry["reason"] = view.reason;
    }
    json["views"].push_back(entry);
  }
  return json;
}

int calibrate(const CalibrateRigArguments& arguments, const Common& common) {
  CalibrationSettings settings;
  apply_settings(settings, arguments.sets);
  ReplayRig replay(arguments.dataset);
  const Board board = board_of(arguments.dataset, arguments.board);
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    try {
      resolve_unwrapping(replay.sequence(), replay.model(), settings.decode, {axis});
    } catch (const Error& e) {
      throw Error(arguments.dataset + ": " + e.what() + "; rig calibration needs patterns in both axes");
    }
  }
  require_not_an_input(arguments.out, {arguments.dataset, arguments.board});
  StagedFolder folder(arguments.out, "calibration");
  std::vector<BoardView> views;
  std::vector<cv::Mat1f> textures;
  {
    Progress progress("finding boards", replay.info().stacks, common.quiet || common.json);
    while (const auto stack = replay.capture(replay.sequence())) {
      views.push_back(observe(*stack, replay.model(), board, settings, textures.emplace_back()));
      progress.step();
    }
  }
  RigCalibration calibration;
  try {
    calibration = calibrate_rig(views, board, replay.model(), settings.calibration);
  } catch (const Error& e) {
    throw Error(arguments.dataset + ": " + e.what());
  }
  write_text(folder.path() / "rig.yaml", to_yaml(calibration.rig));
  write_text(folder.path() / "calibration.json", json_text(to_json(calibration), 2) + "\n");
  write_png(folder.path() / "coverage.png", coverage_picture(calibration));
  write_calibration_page(folder.path(), calibration, textures);
  folder.commit();
  for (const std::string& warning : calibration.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (common.json)
    std::printf("%s\n", json_text(to_json(calibration), 2).c_str());
  else
    std::printf("%s\nwritten: %s  (rig.yaml, calibration.json, calibration.html, coverage.png)\n",
                to_table(calibration).c_str(), arguments.out.c_str());
  return 0;
}

}  // namespace

Verb add_calibrate_rig(Command group, const Common& common) {
  auto arguments = std::make_shared<CalibrateRigArguments>();
  const Command verb =
      group.add_subcommand("rig", "Camera and projector lenses and their relative pose, from views of a flat board");
  verb.add_option("dataset", arguments->dataset, "Dataset of board views with patterns in both axes").required();
  verb.add_option("--board", arguments->board, "Board file (default: DATASET/board.yaml)");
  verb.add_option("--out", arguments->out, "Folder for rig.yaml, calibration.json and calibration.html").required();
  verb.add_option("--set", arguments->sets, "calibration.key=value or decode.key=value (repeatable; listed below)");
  verb.footer(groups_help(CalibrationSettings()));
  return [arguments, &common] { return calibrate(*arguments, common); };
}

}  // namespace fringeslam::tools
