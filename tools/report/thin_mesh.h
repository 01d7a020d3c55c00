// SPDX-License-Identifier: Apache-2.0
// A mesh or cloud with fewer vertices, for a page that has to stay small: vertices of one cell of a cubic grid become
// one (Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993).
#pragma once

#include "core/map/surface_mesh.h"

namespace fringeslam::tools {

struct ThinMesh {
  SurfaceMesh mesh;
  double cell_m = 0;  // edge of the grid's cells; 0: nothing was left out
};

// At most `max_vertices` of the mesh's own, of each cell the one nearest to the cell's mean: it still lies on the
// surface. Grey values are the cells' means. Triangles whose corners fall together are left out.
ThinMesh thinned(SurfaceMesh mesh, size_t max_vertices);

}  // namespace fringeslam::tools
