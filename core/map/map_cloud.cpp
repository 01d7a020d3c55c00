// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_cloud.h"

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
  const int32_t edge = tile_edge(map, cell_m);
  const std::vector<MapTile> tiles = tiles_of(map, edge * cell_m, cell_m);
  for (size_t t = 0; t < tiles.size(); ++t) {
    CellRange range;
    for (size_t i = 0; i < 3 && edge > 0; ++i) {
      range.first[i] = edge * tiles[t].index[i];
      range.last[i] = range.first[i] + edge - 1;
    }
    CloudMap cloud(cell_m, range);
    for (const size_t i : tiles[t].frames) {
      const MapFrame& frame = map.frames()[i];
      cloud.add(restored(frame.frame, map.rays()), map.world_from_camera(frame));
    }
    take(cloud.points());
    if (progress) progress(t + 1, tiles.size());
  }
}

std::vector<CloudPoint> cloud_of(const KeyframeMap& map, const CloudOptions& options) {
  std::vector<CloudPoint> all;
  for_each_cloud_part(map, options,
                      [&](const std::vector<CloudPoint>& part) { all.insert(all.end(), part.begin(), part.end()); });
  return all;
}

}  // namespace fringeslam
