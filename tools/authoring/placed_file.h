// SPDX-License-Identifier: Apache-2.0
// placed.yaml, the file beside a scene that receives what its author drags on the page. The scene includes it, so that
// the author's own files, with their comments, stay as they are.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>

namespace fringeslam::tools {

constexpr const char* kPlacedFile = "placed.yaml";

// True for key paths of positions: objects.2.pose.translation_m, trajectory.spline.waypoints.0.camera_m, …
bool is_position(const std::string& path);

// Writes a position, m, to the placed.yaml of `folder` and keeps its other entries; the file appears completely or not at
// all. Throws Error if a file of this name was not written by this function or contains another section, if `path` is not
// is_position(), or if the position is not finite or farther than 10 km away.
void place(const std::filesystem::path& folder, const std::string& path, const Eigen::Vector3d& position_m);

// Writes an empty placed.yaml unless there is one. Throws Error as place().
void create_placed(const std::filesystem::path& folder);

}  // namespace fringeslam::tools
