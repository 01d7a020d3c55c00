// SPDX-License-Identifier: Apache-2.0
// Scenes made from a mesh file.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace fringeslam::tools {

// Creates the folder of a scene that shows a mesh on a floor from several sides, with a copy of the mesh and of the rig whose
// field fits it. A mesh of more than 10 m in units of 1 m is taken to be in millimeters. `write_mesh` writes the mesh, whose file
// is named `mesh`, to a path in the new folder; materials and textures that are not beside it are left out. Throws Error if
// the folder exists, or the mesh cannot be read or makes no valid scene.
void create_mesh_scene(const std::filesystem::path& mesh, const std::filesystem::path& folder,
                       const std::function<void(const std::filesystem::path&)>& write_mesh);

// Copies a mesh and the files that it refers to in its folder, ../materials/textures and ../textures; files of the latter two
// are put beside the copy. Throws Error if the mesh cannot be read, or refers to files elsewhere.
void copy_mesh(const std::filesystem::path& mesh, const std::filesystem::path& copy);

// Returns a name for the scene of a mesh file: its stem, with letters, digits, - and _ only.
std::string scene_name_of(const std::filesystem::path& mesh);

}  // namespace fringeslam::tools
