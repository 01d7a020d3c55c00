// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_cloud.h"

#include "core/base/in_order.h"
#include "core/map/map_tiles.h"

namespace fringeslam {

double cell_m_of(const RigModel& rig, const CloudOptions& options) {
  check_options(options, "cloud");
  return options.cell_m > 0 ? options.cell_m : rig.pixel_footprint_m();
}

void for_each_cloud_part(const KeyframeMap& map, const CloudOptions& options,
                         const std::function<void(const std::vector<CloudPoint>&)>& take,
                         const TileProgress& progress) {
  const double cell_m = cell_m_of(map.rig(), options);
  const MapTiles tiling = tiles_of(map, tile_edge(map, cell_m), cell_m, cell_m);
  const std::vector<MapTile>& tiles = tiling.tiles;
  const auto points_of = [&](size_t number) {
    const MapTile& tile = tiles[number];
    CloudMap cloud(cell_m, tiling.range(tile));
    for_each_frame(map, tile.frames,
                   [&](const Frame& frame, const Pose& world_from_camera) { cloud.add(frame, world_from_camera); });
    return cloud.points();
  };
  constexpr size_t kMostTogether = 5;  // limits the memory use
  size_t done = 0;
  in_order(tiles.size(), kMostTogether, points_of, [&](const std::vector<CloudPoint>& part) {
    take(part);
    if (progress) progress(++done, tiles.size());
  });
}

std::vector<CloudPoint> cloud_of(const KeyframeMap& map, const CloudOptions& options) {
  std::vector<CloudPoint> all;
  for_each_cloud_part(map, options,
                      [&](const std::vector<CloudPoint>& part) { all.insert(all.end(), part.begin(), part.end()); });
  return all;
}

}  // namespace fringeslam
