// SPDX-License-Identifier: Apache-2.0
// Simplifies a mesh or cloud for a page of limited size by vertex clustering: the vertices in a cell of a cubic grid
// become one (Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993).
#pragma once

#include "core/map/surface_mesh.h"

namespace fringeslam::tools {

struct SimplifiedMesh {
  SurfaceMesh mesh;
  double cell_m = 0;  // edge of the grid's cells; 0: not simplified
};

// Keeps at most `max_vertices`: in each cell the vertex nearest to the cell's mean, so that it still lies on the
// surface. Grey values are the cells' means. Triangles that become degenerate are removed.
SimplifiedMesh thinned(SurfaceMesh mesh, size_t max_vertices);

}  // namespace fringeslam::tools
