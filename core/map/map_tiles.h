// SPDX-License-Identifier: Apache-2.0
// Divides a map into cubes, so that what is fused from all of its frames never has to be in memory at once.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/map/grid_range.h"
#include "core/map/keyframe_map.h"

namespace fringeslam {

// A cube of cells or bricks, and the frames that reach into it.
struct MapTile {
  GridIndex index{};           // of the tile, from 0
  std::vector<size_t> frames;  // positions in KeyframeMap::frames(), ascending
};

// Tile i covers the units from origin + i edge to origin + (i + 1) edge - 1 of each axis of the world; a unit is a cell or a
// brick. The first tiles start where the map starts, so that a map whose height is less than an edge has a single layer.
struct MapTiles {
  int32_t edge = 0;  // units; 0: a single tile covers everything
  GridIndex origin{};
  std::vector<MapTile> tiles;  // in ascending order of their indices

  // The tile's units, and `margin` more on each side.
  GridRange range(const MapTile& tile, int32_t margin = 0) const;
  // Whether a unit is the last one of a tile along any axis.
  bool is_last(const GridIndex& unit) const;
};

// Restores frames of the map, in the given order, and passes them with their camera poses to `take`. Few frames are in
// memory at a time.
void for_each_frame(const KeyframeMap& map, std::span<const size_t> frames,
                    const std::function<void(Frame, const Pose& world_from_camera)>& take);

// Receives how many of all tiles are finished.
using TileProgress = std::function<void(size_t done, size_t all)>;

// Returns the number of cells or voxels of `unit_m` along the edge of a tile: enough for two views, and at least 1,024. 0 for
// maps of a few frames, which need no tiles.
int32_t tile_edge(const KeyframeMap& map, double unit_m);

// Divides the map into tiles of `edge` units of `unit_m`. A frame belongs to the tiles within `margin_m` of its points, or of
// boxes that contain some of these. Throws Error if a pose is so far from the origin that the units cannot be numbered.
MapTiles tiles_of(const KeyframeMap& map, int32_t edge, double unit_m, double margin_m);

}  // namespace fringeslam
