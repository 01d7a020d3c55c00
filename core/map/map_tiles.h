// SPDX-License-Identifier: Apache-2.0
// Divides a map into cubes, so that what is fused from all of its frames never has to be in memory at once.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/map/grid_range.h"
#include "core/map/keyframe_map.h"

namespace fringeslam {

// Cubic tiles with edges of `edge_m`; tile i covers [i edge_m, (i + 1) edge_m) of each axis of the world. 0: a single tile
// covers everything.
struct MapTile {
  GridIndex index{};
  std::vector<size_t> frames;  // positions in KeyframeMap::frames(), ascending

  // The tile's cells or bricks, of which `edge` lie along its edge, and `margin` more on each side; 0: all.
  GridRange range(int32_t edge, int32_t margin = 0) const;
};

// Restores frames of the map, in the given order, and passes them with their camera poses to `take`. Few frames are in
// memory at a time.
void for_each_frame(const KeyframeMap& map, const std::vector<size_t>& frames,
                    const std::function<void(Frame, const Pose& world_from_camera)>& take);

// Receives how many of all tiles are finished.
using TileProgress = std::function<void(size_t done, size_t all)>;

// Returns the number of cells or voxels of `unit_m` along the edge of a tile: enough for one and a half views, and at least
// 1,024. 0 for maps of a few frames, which need no tiles.
int32_t tile_edge(const KeyframeMap& map, double unit_m);

// Returns the tiles that frames may have points in, or within `margin_m` of, in ascending order of their indices, each
// with those frames. A frame's points are bounded by its least and greatest depth. Throws Error if a pose is so far from
// the origin that the tiles cannot be numbered.
std::vector<MapTile> tiles_of(const KeyframeMap& map, double edge_m, double margin_m);

}  // namespace fringeslam
