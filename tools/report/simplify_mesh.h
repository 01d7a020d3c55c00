// SPDX-License-Identifier: Apache-2.0
// Simplifies a mesh or cloud for a page of limited size by vertex clustering: the vertices in a cell of a cubic grid
// become one (Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993).
#pragma once

#include <filesystem>

#include "core/map/surface_mesh.h"

namespace fringeslam::tools {

struct SimplifiedMesh {
  SurfaceMesh mesh;
  double cell_m = 0;  // edge of the grid's cells; 0: not simplified
  uint64_t whole_vertices = 0, whole_triangles = 0;
};

// Keeps at most `max_vertices`: in each cell the vertex nearest to the cell's mean, so that it still lies on the
// surface. Grey values are the cells' means. Triangles that become degenerate are removed.
SimplifiedMesh thinned(const SurfaceMesh& mesh, size_t max_vertices);

// Simplifies a mesh or cloud written by PlyWriter in several passes, without reading all of it into memory. Throws Error if
// the file cannot be read.
SimplifiedMesh thinned(const std::filesystem::path& ply, size_t max_vertices);

}  // namespace fringeslam::tools
