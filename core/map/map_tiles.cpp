// SPDX-License-Identifier: Apache-2.0
#include "core/map/map_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

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

// Bounds of a frame's points in units.
struct UnitBox {
  size_t frame;
  GridIndex first, last;
};

// Returns the units within `margin_m` of what the frame may see; empty if it sees nothing.
std::optional<UnitBox> box_of(const MapFrame& frame, const Pose& world_from_camera, const RayBounds& rays,
                              double unit_m, double margin_m) {
  float nearest_m = std::numeric_limits<float>::infinity(), farthest_m = 0;
  for (const float depth_m : frame.frame.depth_m) {
    if (!(depth_m > 0)) continue;
    nearest_m = std::min(nearest_m, depth_m);
    farthest_m = std::max(farthest_m, depth_m);
  }
  if (!(farthest_m > 0)) return std::nullopt;
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    const double z = static_cast<double>(corner & 4 ? farthest_m : nearest_m);
    const Eigen::Vector3d point = world_from_camera * Eigen::Vector3d(z * (corner & 1 ? rays.high : rays.low).x(),
                                                                      z * (corner & 2 ? rays.high : rays.low).y(), z);
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  constexpr double kMostUnits = 1e9;
  UnitBox box{};
  for (int i = 0; i < 3; ++i) {
    const double first = std::floor((low[i] - margin_m) / unit_m), last = std::floor((high[i] + margin_m) / unit_m);
    if (!(std::abs(first) < kMostUnits && std::abs(last) < kMostUnits))
      throw Error("map: frame " + std::to_string(frame.frame.index) + " is too far from the origin");
    box.first[static_cast<size_t>(i)] = static_cast<int32_t>(first);
    box.last[static_cast<size_t>(i)] = static_cast<int32_t>(last);
  }
  return box;
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
  return std::max(kLeast, kStep * static_cast<int32_t>(std::ceil(1.5 * view_m / unit_m / kStep)));
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
  const RayBounds rays = bounds_of(map.rays());
  result.origin.fill(std::numeric_limits<int32_t>::max());
  std::vector<UnitBox> boxes;
  constexpr size_t kResident = 64;  // frames whose pages are in memory at a time
  for (size_t i = 0; i < frames.size(); ++i) {
    if (i % kResident == 0) map.release_frames();
    auto box = box_of(frames[i], map.world_from_camera(frames[i]), rays, unit_m, margin_m);
    if (!box) continue;
    box->frame = i;
    boxes.push_back(*box);
    for (size_t axis = 0; axis < 3; ++axis) result.origin[axis] = std::min(result.origin[axis], box->first[axis]);
  }
  map.release_frames();
  std::map<GridIndex, std::vector<size_t>> tiles;
  for (const UnitBox& box : boxes) {
    GridIndex first, last;
    for (size_t axis = 0; axis < 3; ++axis) {
      first[axis] = (box.first[axis] - result.origin[axis]) / edge;
      last[axis] = (box.last[axis] - result.origin[axis]) / edge;
    }
    for (int32_t x = first[0]; x <= last[0]; ++x) {
      for (int32_t y = first[1]; y <= last[1]; ++y) {
        for (int32_t z = first[2]; z <= last[2]; ++z) tiles[{x, y, z}].push_back(box.frame);
      }
    }
  }
  for (auto& [index, members] : tiles) result.tiles.push_back({index, std::move(members)});
  return result;
}

}  // namespace fringeslam
