// SPDX-License-Identifier: Apache-2.0
// Extraction of the zero surface of bricks of signed distances as triangles, by surface nets (Gibson, Constrained
// elastic surface nets, 1998): a cell of eight neighbouring voxels whose distances differ in sign has one vertex, the
// mean of its edges' zero crossings, and each grid edge whose ends differ in sign is crossed by the quad of its four
// cells' vertices.
//
// A cell needs all eight voxels observed, and a quad all four vertices: the surface ends where nothing was observed,
// and holes stay open. (OpenVDB's volumeToMesh would treat missing voxels as background values and close every
// surface.) A cell has no vertex either if the distances at the ends of a crossed edge differ by much more than its
// length: a distance field changes by at most the path length, so these values belong to two surfaces, one occluding
// the other.
#pragma once

#include <vector>

#include "core/map/surface_bricks.h"
#include "core/map/surface_mesh.h"

namespace fringeslam {

// Triangulates the bricks. Voxels with a weight below min_weight, or 0, count as unobserved. Vertices follow the order
// of the bricks.
SurfaceMesh surface_nets(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight);

// A cell of a brick, z varying fastest.
struct SurfaceCell {
  uint64_t brick_key = 0;
  uint16_t cell = 0;
  bool operator==(const SurfaceCell&) const = default;
};

// Part of a mesh, and the cells of its vertices.
struct SurfacePatch {
  SurfaceMesh mesh;
  std::vector<SurfaceCell> cells;
};

// Triangulates part of a surface: the triangles around grid edges that start in bricks of `range`. They equal those of the
// whole surface if `bricks` holds all bricks within one of `range`.
SurfacePatch surface_nets(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight,
                          const GridRange& range);

}  // namespace fringeslam
