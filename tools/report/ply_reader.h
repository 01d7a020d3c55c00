// SPDX-License-Identifier: Apache-2.0
// The map.ply and mesh.ply that a run wrote.
#pragma once

#include <filesystem>

#include "core/map/surface_mesh.h"

namespace fringeslam::tools {

// Triangles are empty for a cloud. Throws Error when the file is missing, truncated, or not one of ours.
SurfaceMesh read_ply(const std::filesystem::path& file);

}  // namespace fringeslam::tools
