// SPDX-License-Identifier: Apache-2.0
// Export of bricks of signed distances to OpenVDB's file format.
#pragma once

#include <string>
#include <vector>

#include "core/map/surface_bricks.h"

namespace fringeslam {

// Returns a .vdb file with the FloatGrid "surface", a level set: signed distances in m, positive in front of the
// surface, at voxels of scale.voxel_m in the world frame; the background is the truncation. Voxels with a weight below
// min_weight, or 0, are inactive and hold the background, so that programs that mesh inactive voxels, too, close the
// surface on its back, about a truncation behind it. Equal bricks give equal bytes with the same version of OpenVDB.
// OpenVDB is loaded by the first call; throws Error if that is not possible.
std::string to_vdb(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight);

}  // namespace fringeslam
