// SPDX-License-Identifier: Apache-2.0
// Writes what a run leaves behind (the layout is in tools/README.md).
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/map/mesh.h"
#include "core/mapper/pipeline.h"
#include "tools/report/pictures.h"
#include "tools/run_score.h"

namespace fringeslam::tools {

class RunFolder {
 public:
  RunFolder(std::filesystem::path folder, const RigModel& rig, const PatternSequence& sequence);

  // The pictures and depth of one view, and one entry of frames.json.
  void add(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map);

  // victims.json: the warm things that a thermal camera found (tools/landmark_files.h).
  void add_warm_things(const std::vector<WarmThing>& things) const;

  // mesh.ply of a view that was added.
  void add_mesh(const Mesh& mesh, int index) const;

  // trajectory.tum, map.ply, mesh.ply, mesh.glb, frames.json, landmarks.json.
  void finish(const Trajectory& trajectory, const std::vector<CloudPoint>& cloud, const SurfaceMesh& mesh);

  // error.png of each view and overview.png; `score` is null where there is no truth.
  void draw_overview(const std::vector<CloudPoint>& cloud, const RunScore* score) const;

 private:
  std::filesystem::path frame_folder(int index) const;

  std::filesystem::path folder_;
  RigModel rig_;
  int finest_image_ = 0;  // of the finest fringes in a whole sequence: shown in the overview
  Trajectory trajectory_;
  std::vector<int> tracked_, lost_;
  nlohmann::ordered_json frames_ = nlohmann::ordered_json::array(), landmarks_ = nlohmann::ordered_json::array();
  // Pictures of the last view that has matches, for the overview.
  int shown_ = 0;
  cv::Mat3b fringe_, phase_, depth_, matches_;
  std::string match_title_;
};

}  // namespace fringeslam::tools
