// SPDX-License-Identifier: Apache-2.0
// Writes the contents of a run folder (tools/README.md documents the layout).
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/map/map_cloud.h"
#include "core/map/mesh.h"
#include "core/mapper/image_trajectory.h"
#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"
#include "tools/background_tasks.h"
#include "tools/report/pictures.h"
#include "tools/run_score.h"

namespace fringeslam::tools {

class RunFolder {
 public:
  RunFolder(std::filesystem::path folder, const RigModel& rig, const PatternSequence& sequence);

  // Writes the images and depth of one view, in the background until finish(), and appends its entries to frames.json
  // and landmarks.json.
  void add(const FringeStack& stack, const FrameResult& result, const ThermalView& thermal, const KeyframeMap& map);

  // Writes victims.json: the warm objects found by a thermal camera (tools/landmark_files.h).
  void add_warm_objects(const std::vector<WarmObject>& things) const;

  // Writes images.tum, the poses of the robot at single images, and images.json, which lists all images.
  void add_image_poses(const ImageTrajectory& images, const Mapper& mapper) const;

  // Replaces the entry and, in finish(), the images of an earlier view by those of its recovered result.
  void replace(const FrameResult& recovered);

  // Writes mesh.ply of a view that was added before.
  void add_mesh(const Mesh& mesh, int index);
  // Replaces it.
  void replace_mesh(const Mesh& mesh, int index);

  // Writes trajectory.tum, frames.json and landmarks.json, and waits for the images.
  void finish(const Trajectory& trajectory);

  // Writes map.ply; only a few tiles of the map are in memory at a time.
  void write_cloud(const KeyframeMap& map, const CloudOptions& options, const TileProgress& progress);
  // Writes mesh.ply and mesh.glb, tile by tile. A mesh that exceeds the limit of GLB files is only written as PLY;
  // returns false then.
  bool write_surface(const KeyframeMap& map, const SurfaceOptions& options, const TileProgress& progress) const;

  // Writes error.png of a view: its depth minus the true depth. Views may be drawn concurrently.
  void draw_error(int index, const DepthEstimate& estimate, const TruthFrame& truth);

  // Writes overview.png, with the depth error if that view was drawn; `score` is null without ground truth.
  void draw_overview(const RunScore* score) const;

 private:
  std::filesystem::path frame_folder(int index) const;

  static constexpr int kWriters = 2;
  std::filesystem::path folder_;
  RigModel rig_;
  BackgroundTasks writing_{kWriters};  // the images of the views
  int finest_image_ = 0;               // index of the image with the finest fringes, shown in the overview
  Trajectory trajectory_;
  std::vector<int> tracked_, lost_;
  nlohmann::ordered_json frames_ = nlohmann::ordered_json::array(), landmarks_ = nlohmann::ordered_json::array();
  // Images of the first tracked view with matches, or of the first view, for the overview.
  int shown_ = 0;
  cv::Mat3b fringe_, phase_, depth_, sigma_, shaded_, texture_, matches_, error_;
  std::string depth_title_, sigma_title_;
  std::vector<std::string> facts_;  // about the view shown, for runs without ground truth
  std::string match_title_;
  std::vector<CloudPoint> cloud_;  // for the overview: every n-th point of the cloud
  size_t cloud_points_ = 0;        // of the whole cloud
};

}  // namespace fringeslam::tools
