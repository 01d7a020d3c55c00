// SPDX-License-Identifier: Apache-2.0
// The entry point of the module that is linked with OpenVDB. to_vdb() calls it.
#pragma once

#include <string>
#include <vector>

#include "core/map/surface_bricks.h"

extern "C" void fringeslam_openvdb_file(const std::vector<fringeslam::Brick>& bricks,
                                        const fringeslam::VoxelScale& scale, double min_weight, std::string& bytes);
