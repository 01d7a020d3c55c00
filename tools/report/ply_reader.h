// SPDX-License-Identifier: Apache-2.0
// Reads the map.ply and mesh.ply written by a run.
#pragma once

#include <filesystem>

#include "core/map/surface_mesh.h"

namespace fringeslam::tools {

// Returns the mesh; a cloud has no triangles. Throws Error if the file is missing, truncated, or of another format.
SurfaceMesh read_ply(const std::filesystem::path& file);

}  // namespace fringeslam::tools
