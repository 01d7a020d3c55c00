// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// Bounds of the pixels' rays at depth 1.
struct RayBounds {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
};

RayBounds bounds_of(const PixelRays& rays) {
  RayBounds bounds;
  for (const cv::Vec2f& ray : rays) {
    const Eigen::Vector2d slope(ray[0], ray[1]);
    bounds.low = bounds.low.cwiseMin(slope);
    bounds.high = bounds.high.cwiseMax(slope);
  }
  return bounds;
}

using TileRange = std::array<std::array<int32_t, 2>, 3>;  // first and last tile of each axis

// Returns the tiles within `margin_m` of what the frame may see; false if it sees nothing.
bool range_of(const StoredFrame& frame, const Pose& world_from_camera, const RayBounds& rays, double edge_m,
              double margin_m, TileRange& range) {
  float nearest_m = std::numeric_limits<float>::infinity(), farthest_m = 0;
  for (const float depth_m : frame.depth_m) {
    if (!(depth_m > 0)) continue;
    nearest_m = std::min(nearest_m, depth_m);
    farthest_m = std::max(farthest_m, depth_m);
  }
  if (!(farthest_m > 0)) return false;
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    const double z = static_cast<double>(corner & 4 ? farthest_m : nearest_m);
    const Eigen::Vector3d point = world_from_camera * Eigen::Vector3d(z * (corner & 1 ? rays.high : rays.low).x(),
                                                                      z * (corner & 2 ? rays.high : rays.low).y(), z);
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  constexpr double kMostTiles = 1e9;
  for (int i = 0; i < 3; ++i) {
    const double first = std::floor((low[i] - margin_m) / edge_m), last = std::floor((high[i] + margin_m) / edge_m);
    if (!(std::abs(first) < kMostTiles && std::abs(last) < kMostTiles))
      throw Error("map: frame " + std::to_string(frame.index) + " is too far from the origin");
    range[static_cast<size_t>(i)] = {static_cast<int32_t>(first), static_cast<int32_t>(last)};
  }
  return true;
}

}  // namespace

GridRange MapTile::range(int32_t edge, int32_t margin) const {
  GridRange range;
  for (size_t i = 0; i < 3 && edge > 0; ++i) {
    range.first[i] = edge * index[i] - margin;
    range.last[i] = edge * (index[i] + 1) - 1 + margin;
  }
  return range;
}

void for_each_frame(const KeyframeMap& map, const std::vector<size_t>& frames,
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
  return std::max(kLeast, kStep * static_cast<int32_t>(std::ceil(1.5 * view_m / unit_m / kStep)));
}

std::vector<MapTile> tiles_of(const KeyframeMap& map, double edge_m, double margin_m) {
  const std::vector<MapFrame>& frames = map.frames();
  if (edge_m == 0) {
    MapTile all;
    for (size_t i = 0; i < frames.size(); ++i) all.frames.push_back(i);
    return frames.empty() ? std::vector<MapTile>{} : std::vector<MapTile>{all};
  }
  const RayBounds rays = bounds_of(map.rays());
  std::map<GridIndex, std::vector<size_t>> tiles;
  constexpr size_t kResident = 64;  // frames whose pages are in memory at a time
  for (size_t i = 0; i < frames.size(); ++i) {
    if (i % kResident == 0) map.release_frames();
    TileRange range;
    if (!range_of(frames[i].frame, map.world_from_camera(frames[i]), rays, edge_m, margin_m, range)) continue;
    for (int32_t x = range[0][0]; x <= range[0][1]; ++x) {
      for (int32_t y = range[1][0]; y <= range[1][1]; ++y) {
        for (int32_t z = range[2][0]; z <= range[2][1]; ++z) tiles[{x, y, z}].push_back(i);
      }
    }
  }
  map.release_frames();
  std::vector<MapTile> list;
  for (auto& [index, members] : tiles) list.push_back({index, std::move(members)});
  return list;
}

}  // namespace fringeslam
