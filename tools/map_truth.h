// SPDX-License-Identifier: Apache-2.0
// Ground truth for scoring maps: a scene's true surface, the part of it that the sensor saw, and the true trajectory.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/io/ply.h"
#include "core/score/map_score.h"
#include "core/types/trajectory.h"
#include "sim/nearest_surface.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

struct MapTruth {
  std::string name;
  sim::NearestSurface surface;
  // Surface points seen by the sensor, world frame, m; of a dataset or run, in its stacks.
  std::vector<Eigen::Vector3d> seen;
  // Poses of the robot; of the camera if the ground truth is a folder in TUM RGB-D or EuRoC layout.
  Trajectory trajectory;
};

// Reads the ground truth from `path`: a scene file or folder, or a dataset, run, TUM RGB-D or EuRoC folder rendered from one.
// Throws Error if the surface is unknown, the sensor sees none of it, or `seed` is given for a rendered folder.
MapTruth read_map_truth(const std::filesystem::path& path, std::optional<uint64_t> seed, const Common& common);

// Scores a map given in world coordinates. For a mesh, accuracy is measured at its vertices, completeness against its
// triangles.
MapScore score_map(const PlyMap& map, const MapTruth& truth, double threshold_m);

// Returns the true trajectory's file: `path` itself, or the file in a dataset, run, TUM RGB-D or EuRoC folder. Throws Error if
// the folder has none.
std::filesystem::path true_trajectory_file(const std::filesystem::path& path);

// Reads the true trajectory of `path`, which may also be a ROS bag written by `render`.
Trajectory true_trajectory(const std::filesystem::path& path);

}  // namespace fringeslam::tools
