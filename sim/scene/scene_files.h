// SPDX-License-Identifier: Apache-2.0
// The files that a scene names, found without making its objects.
#pragma once

#include <filesystem>
#include <vector>

namespace fringeslam::sim {

// Returns the scene file, its included files, and the rigs, meshes, textures and trajectories that they name, also those that
// do not exist. Textures that mesh files name are not included. Throws Error if the scene file or an included file cannot be read.
std::vector<std::filesystem::path> named_files(const std::filesystem::path& scene_file);

}  // namespace fringeslam::sim
