// SPDX-License-Identifier: Apache-2.0
// The cloud of a whole map, one tile after another.
#pragma once

#include <functional>
#include <vector>

#include "core/map/cloud.h"
#include "core/map/map_tiles.h"

namespace fringeslam {

// Returns the edge length of the cells: cell_m or, if that is 0, the footprint of a pixel at mid range.
double cell_m_of(const RigModel& rig, const CloudOptions& options);

// Merges all frames of the map at their current poses, and passes the points of each tile to `take`, sorted by their cells'
// coordinates within a tile. Only a few tiles are in memory at a time.
void for_each_cloud_part(const KeyframeMap& map, const CloudOptions& options,
                         const std::function<void(const std::vector<CloudPoint>&)>& take,
                         const TileProgress& progress = {});

// Returns all of these points.
std::vector<CloudPoint> cloud_of(const KeyframeMap& map, const CloudOptions& options);

}  // namespace fringeslam
