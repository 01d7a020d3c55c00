// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// Bounds of some of a frame's points in units.
struct UnitBox {
  GridIndex first, last;
};

// Returns the units within `margin_m` of the frame's points.
std::vector<UnitBox> unit_boxes(const MapFrame& frame, const Pose& world_from_camera, const PixelRays& rays,
                                double unit_m, double margin_m) {
  constexpr double kMostUnits = 1e9;
  std::vector<UnitBox> boxes;
  for (const WorldBox& points : boxes_of(frame.frame, rays, world_from_camera)) {
    UnitBox& box = boxes.emplace_back();
    for (size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<int>(i);
      const double first = std::floor((points.low_m[axis] - margin_m) / unit_m);
      const double last = std::floor((points.high_m[axis] + margin_m) / unit_m);
      if (!(std::abs(first) < kMostUnits && std::abs(last) < kMostUnits))
        throw Error("map: frame " + std::to_string(frame.frame.index) + " is too far from the origin");
      box.first[i] = static_cast<int32_t>(first);
      box.last[i] = static_cast<int32_t>(last);
    }
  }
  return boxes;
}

}  // namespace

GridRange MapTiles::range(const MapTile& tile, int32_t margin) const {
  GridRange range;
  for (size_t i = 0; i < 3 && edge > 0; ++i) {
    range.first[i] = origin[i] + edge * tile.index[i] - margin;
    range.last[i] = origin[i] + edge * (tile.index[i] + 1) - 1 + margin;
  }
  return range;
}

bool MapTiles::is_last(const GridIndex& unit) const {
  bool last = false;
  for (size_t i = 0; i < 3 && edge > 0; ++i) last |= (unit[i] + 1 - origin[i]) % edge == 0;
  return last;
}

void for_each_frame(const KeyframeMap& map, std::span<const size_t> frames,
                    const std::function<void(Frame, const Pose&)>& take) {
  constexpr size_t kResident = 32;  // frames whose pages are in memory at a time
  for (size_t i = 0; i < frames.size(); ++i) {
    if (i % kResident == 0) map.release_frames();
    const MapFrame& frame = map.frames()[frames[i]];
    take(restored(frame.frame, map.rays()), map.world_from_camera(frame));
  }
}

int32_t tile_edge(const KeyframeMap& map, double unit_m) {
  constexpr size_t kFew = 32;
  constexpr int32_t kLeast = 1024, kStep = 8;  // whole bricks of voxels
  if (map.frames().size() <= kFew) return 0;
  const double view_m = std::max(map.rig().camera.width, map.rig().camera.height) * map.rig().pixel_footprint_m();
  return std::max(kLeast, kStep * static_cast<int32_t>(std::ceil(2.0 * view_m / unit_m / kStep)));
}

MapTiles tiles_of(const KeyframeMap& map, int32_t edge, double unit_m, double margin_m) {
  const std::vector<MapFrame>& frames = map.frames();
  MapTiles result;
  result.edge = edge;
  if (edge == 0) {
    MapTile all;
    for (size_t i = 0; i < frames.size(); ++i) all.frames.push_back(i);
    if (!frames.empty()) result.tiles.push_back(std::move(all));
    return result;
  }
  result.origin.fill(std::numeric_limits<int32_t>::max());
  std::vector<std::vector<UnitBox>> boxes(frames.size());
  constexpr size_t kResident = 64;  // frames whose pages are in memory at a time
  for (size_t i = 0; i < frames.size(); ++i) {
    if (i % kResident == 0) map.release_frames();
    boxes[i] = unit_boxes(frames[i], map.world_from_camera(frames[i]), map.rays(), unit_m, margin_m);
    for (const UnitBox& box : boxes[i]) {
      for (size_t axis = 0; axis < 3; ++axis) result.origin[axis] = std::min(result.origin[axis], box.first[axis]);
    }
  }
  map.release_frames();
  std::map<GridIndex, std::vector<size_t>> tiles;
  for (size_t i = 0; i < frames.size(); ++i) {
    for (const UnitBox& box : boxes[i]) {
      GridIndex first, last;
      for (size_t axis = 0; axis < 3; ++axis) {
        first[axis] = (box.first[axis] - result.origin[axis]) / edge;
        last[axis] = (box.last[axis] - result.origin[axis]) / edge;
      }
      for (int32_t x = first[0]; x <= last[0]; ++x) {
        for (int32_t y = first[1]; y <= last[1]; ++y) {
          for (int32_t z = first[2]; z <= last[2]; ++z) {
            std::vector<size_t>& members = tiles[{x, y, z}];
            if (members.empty() || members.back() != i) members.push_back(i);
          }
        }
      }
    }
  }
  for (auto& [index, members] : tiles) result.tiles.push_back({index, std::move(members)});
  return result;
}

}  // namespace fringeslam
