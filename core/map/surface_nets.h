// SPDX-License-Identifier: Apache-2.0
// The zero surface of bricks of signed distances as triangles, by surface nets (Gibson, Constrained elastic surface
// nets, 1998): a cell of eight neighbouring voxels whose distances differ in sign has one vertex, at the mean of its
// edges' zero crossings, and each grid edge whose ends differ in sign is crossed by the quad of its four cells'
// vertices.
//
// A cell needs all eight voxels observed, and a quad all four vertices: where nothing was seen the surface ends, and a
// hole stays a hole. (OpenVDB's volumeToMesh takes what is not stored for a value of its own, and would close every
// surface against it.) Nor does a cell have a vertex when a crossed edge's distances differ by much more than its
// length: distance changes no faster than the way, so these belong to two surfaces, of which one hides the other.
#pragma once

#include <vector>

#include "core/map/surface_bricks.h"
#include "core/map/surface_mesh.h"

namespace fringeslam {

struct Brick {
  BrickIndex index;
  const int64_t* voxels;
};

// Voxels with less than min_weight (and with none) count as unobserved. Vertices follow the order of the bricks.
SurfaceMesh surface_nets(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight);

}  // namespace fringeslam
