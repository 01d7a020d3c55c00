// SPDX-License-Identifier: Apache-2.0
// What maps are scored against: the true surface of a scene, what of it the sensor saw, and where the sensor was.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/score/map_score.h"
#include "core/score/ply_file.h"
#include "core/types/trajectory.h"
#include "sim/nearest_surface.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

struct MapTruth {
  std::string name;
  sim::NearestSurface surface;
  std::vector<Eigen::Vector3d> seen;  // world frame
  // Of the robot; of the camera where the truth is a folder in TUM RGB-D layout.
  Trajectory trajectory;
};

// `path`: scene file or folder, or a dataset, run or TUM RGB-D folder that was rendered from one.
MapTruth read_map_truth(const std::filesystem::path& path, std::optional<uint64_t> seed, const Common& common);

// The map's coordinates are those of the world. A mesh is its triangles, and scored by its vertices.
MapScore score_map(const PlyMap& map, const MapTruth& truth, double threshold_m);

// The true trajectory that a path means: itself, or that of a dataset, run or TUM RGB-D folder.
std::filesystem::path true_trajectory_file(const std::filesystem::path& path);

}  // namespace fringeslam::tools
