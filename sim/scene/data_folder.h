// SPDX-License-Identifier: Apache-2.0
// Where the scenes, rigs and suites of the project are: installed with the library, or in the source tree it was built in.
#pragma once

#include <filesystem>

namespace fringeslam::sim {

constexpr const char* kSceneFile = "scene.yaml";

// Returns the folder that contains `scenes/`: $FRINGESLAM_DATA, else PREFIX/share/fringeslam for a library installed below
// PREFIX, else the source tree above the library. Empty if there is none.
std::filesystem::path data_folder();

// Returns the scene file that a user means: a file, scene.yaml in a folder, or the scene of that name in data_folder(). A
// path that is none of these is returned unchanged.
std::filesystem::path scene_file(const std::filesystem::path& path);

}  // namespace fringeslam::sim
