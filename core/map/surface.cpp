// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <future>
#include <numbers>
#include <numeric>
#include <span>
#include <unordered_map>

#include "core/base/in_order.h"
#include "core/base/parallel.h"
#include "core/map/brick_map.h"
#include "core/map/surface_fusion.h"
#include "core/map/surface_nets.h"
#include "core/map/surface_vdb.h"

namespace fringeslam {

namespace {

constexpr int kTogether = 16;  // bricks per parallel task

VoxelScale scale_of(const RigModel& rig, const SurfaceOptions& options) {
  check_options(options, "surface");
  const double voxel_m = options.voxel_m > 0 ? options.voxel_m : rig.pixel_footprint_m();
  return {voxel_m, options.truncation_voxels * voxel_m};
}

// Calls body(i) for every i in [0, count), in parallel.
template <class Body>
void for_each(size_t count, const Body& body) {
  for_each_row(static_cast<int>((count + kTogether - 1) / kTogether), [&](int piece) {
    const size_t first = static_cast<size_t>(piece) * kTogether;
    for (size_t i = first; i < std::min(first + kTogether, count); ++i) body(i);
  });
}

}  // namespace

class SurfaceModel::Grid {
 public:
  Grid(const RigModel& rig, const SurfaceOptions& surface)
      : camera(rig.camera), scale(scale_of(rig, surface)), options(surface) {}

  // Frames ready to be fused. Kept between uses, since allocating memory costs more than writing to it.
  struct Prepared {
    std::vector<FramePlanes> frames;
    BrickSet touched;
  };

  void check(const PosedFrame& posed) const;
  // Prepares at most kMaxFusedFrames frames. Several threads may prepare frames while another fuses some.
  void prepare(const PosedFrame* first, size_t count, Prepared& prepared) const;
  void fuse(const Prepared& prepared);
  // Ignores everything outside these bricks from now on.
  void limit(const GridRange& range) { range_ = range; }

  // Returns the smallest weight of voxels that belong to the surface.
  double min_weight() const { return 1 / (options.max_sigma_m * options.max_sigma_m); }

  Pinhole camera;
  VoxelScale scale;
  SurfaceOptions options;
  BrickMap bricks;
  Prepared scratch;  // of add()

 private:
  GridRange range_;
};

void SurfaceModel::Grid::check(const PosedFrame& posed) const {
  const Frame& frame = posed.frame;
  if (frame.width() != camera.width || frame.height() != camera.height)
    throw Error("surface: the frame is " + std::to_string(frame.width()) + "x" + std::to_string(frame.height()) +
                ", the camera " + std::to_string(camera.width) + "x" + std::to_string(camera.height));
  // Half the range of brick keys; the other half is for what the camera sees from there.
  const double reach_m = kMaxBrick / 2 * kBrickEdge * scale.voxel_m;
  const Pose& pose = posed.world_from_camera;
  if (!(pose.translation.cwiseAbs().maxCoeff() <= reach_m) || !pose.is_finite())
    throw Error("surface: a pose is not within " + to_text(reach_m) + " m of the origin");
}

void SurfaceModel::Grid::prepare(const PosedFrame* first, size_t count, Prepared& prepared) const {
  const PlaneLimits limits{options.max_slope_deg, options.min_sigma_m, options.max_off_plane_sigma};
  std::vector<FramePlanes>& frames = prepared.frames;
  while (frames.size() < count) frames.emplace_back(camera, scale, limits);
  prepared.touched.clear();
  for (size_t i = 0; i < count; ++i) {
    frames[i].take(first[i].frame, first[i].world_from_camera);
    frames[i].collect(static_cast<int>(i), prepared.touched);
  }
}

void SurfaceModel::Grid::fuse(const Prepared& prepared) {
  const std::vector<TouchedBrick>& touched = prepared.touched.bricks();
  // The map may be searched in parallel but not modified: new bricks are added at the end.
  std::vector<std::unique_ptr<BrickVoxels>> fresh(touched.size());
  for_each(touched.size(), [&](size_t i) {
    if (!range_.contains(brick_of(touched[i].key))) return;
    int64_t* voxels = bricks.find(touched[i].key);
    if (voxels == nullptr) {
      fresh[i] = std::make_unique<BrickVoxels>();  // unobserved voxels
      voxels = fresh[i]->data();
    }
    const bool seen = fringeslam::fuse(prepared.frames, touched[i], voxels);
    if (!seen) fresh[i].reset();
  });
  for (size_t i = 0; i < touched.size(); ++i) {
    if (fresh[i]) bricks.add(touched[i].key, std::move(fresh[i]));
  }
}

SurfaceModel::SurfaceModel(const RigModel& rig, const SurfaceOptions& options)
    : grid_(std::make_unique<Grid>(rig, options)) {}
SurfaceModel::~SurfaceModel() = default;
SurfaceModel::SurfaceModel(SurfaceModel&&) noexcept = default;
SurfaceModel& SurfaceModel::operator=(SurfaceModel&&) noexcept = default;

void SurfaceModel::add(const std::vector<PosedFrame>& frames) {
  for (const PosedFrame& frame : frames) grid_->check(frame);
  for (size_t i = 0; i < frames.size(); i += kMaxFusedFrames) {
    grid_->prepare(frames.data() + i, std::min<size_t>(kMaxFusedFrames, frames.size() - i), grid_->scratch);
    grid_->fuse(grid_->scratch);
  }
}

namespace {

struct CellHash {
  size_t operator()(const SurfaceCell& cell) const {
    return static_cast<size_t>((cell.brick_key ^ static_cast<uint64_t>(cell.cell) << 55) * 0x9e3779b97f4a7c15u >> 7);
  }
};

// Numbers the vertices of a mesh that is made of patches. Vertices at the border of a tile belong to several patches.
class PatchStitcher {
 public:
  // `tiles` consist of bricks.
  explicit PatchStitcher(const MapTiles& tiles) : tiles_(tiles) {}

  // Removes the vertices that an earlier patch had, and lets the triangles refer to all vertices so far.
  SurfaceMesh stitched(SurfacePatch patch) {
    SurfaceMesh part;
    std::vector<uint32_t> numbers(patch.mesh.vertices.size());
    for (size_t i = 0; i < numbers.size(); ++i) {
      const SurfaceCell& cell = patch.cells[i];
      // Triangles use vertices of their own brick and of those that precede it.
      const bool shared = tiles_.is_last(brick_of(cell.brick_key));
      const auto next = static_cast<uint32_t>(count_ + part.vertices.size());
      numbers[i] = shared ? border_.emplace(cell, next).first->second : next;
      if (numbers[i] == next) part.vertices.push_back(patch.mesh.vertices[i]);
    }
    count_ += part.vertices.size();
    part.triangles = std::move(patch.mesh.triangles);
    for (auto& triangle : part.triangles) {
      for (uint32_t& vertex : triangle) vertex = numbers[vertex];
    }
    return part;
  }

 private:
  const MapTiles& tiles_;
  size_t count_ = 0;
  std::unordered_map<SurfaceCell, uint32_t, CellHash> border_;
};

}  // namespace

// Fuses frames of the map. While some are fused, the next ones are prepared in another thread.
void SurfaceModel::add_frames(const KeyframeMap& map, const std::vector<size_t>& frames) {
  constexpr size_t kTogether = kMaxFusedFrames;  // limits the memory use
  std::array<Grid::Prepared, 2> prepared;
  const auto prepare = [&](size_t first, Grid::Prepared& into) {
    const size_t count = std::min(kTogether, frames.size() - first);
    std::vector<PosedFrame> together;
    for_each_frame(map, std::span(frames).subspan(first, count), [&](Frame frame, const Pose& world_from_camera) {
      together.push_back({std::move(frame), world_from_camera});
      grid_->check(together.back());
    });
    grid_->prepare(together.data(), count, into);
  };
  if (!frames.empty()) prepare(0, prepared[0]);
  for (size_t first = 0, turn = 0; first < frames.size(); first += kTogether, turn = 1 - turn) {
    std::future<void> next;
    if (const size_t following = first + kTogether; following < frames.size())
      next = std::async(beside_caller(), [&, following, turn] { prepare(following, prepared[1 - turn]); });
    grid_->fuse(prepared[turn]);
    if (next.valid()) next.get();
  }
}

SurfaceModel surface_of(const KeyframeMap& map, const SurfaceOptions& options) {
  SurfaceModel surface(map.rig(), options);
  std::vector<size_t> all(map.frames().size());
  std::iota(all.begin(), all.end(), size_t{0});
  surface.add_frames(map, all);
  return surface;
}

void for_each_surface_part(const KeyframeMap& map, const SurfaceOptions& options,
                           const std::function<void(const SurfaceMesh&)>& take, const TileProgress& progress) {
  const VoxelScale scale = scale_of(map.rig(), options);
  const int32_t edge = tile_edge(map, scale.voxel_m) / kBrickEdge;
  // The triangles of a tile need all bricks next to it, and these need all frames with a point whose band reaches them: its
  // length is that of the truncation and of a pixel's footprint on the steepest usable surface (frame_planes.cpp).
  const double footprint_m = map.rig().far_m / std::min(map.rig().camera.fx, map.rig().camera.fy);
  const double slope = std::tan(options.max_slope_deg * std::numbers::pi / 180);
  const double margin_m = scale.truncation_m + (1 + slope) * footprint_m + (kBrickEdge + 1) * scale.voxel_m;
  const MapTiles tiling = tiles_of(map, edge, kBrickEdge * scale.voxel_m, margin_m);
  const std::vector<MapTile>& tiles = tiling.tiles;
  PatchStitcher stitcher(tiling);
  const auto patch_of = [&](const MapTile& tile) {
    SurfaceModel surface(map.rig(), options);
    surface.grid_->limit(tiling.range(tile, 1));
    surface.add_frames(map, tile.frames);
    return surface_nets(surface.grid_->bricks.bricks(), scale, surface.grid_->min_weight(), tiling.range(tile));
  };
  // A part is taken while the next one is made.
  std::future<SurfacePatch> next;
  for (size_t t = 0; t < tiles.size(); ++t) {
    SurfacePatch patch = next.valid() ? next.get() : patch_of(tiles[t]);
    if (t + 1 < tiles.size()) next = std::async(beside_caller(), patch_of, std::cref(tiles[t + 1]));
    take(stitcher.stitched(std::move(patch)));
    if (progress) progress(t + 1, tiles.size());
  }
}

SurfaceMesh SurfaceModel::mesh() const {
  return surface_nets(grid_->bricks.bricks(), grid_->scale, grid_->min_weight());
}

std::string SurfaceModel::to_vdb() const {
  return fringeslam::to_vdb(grid_->bricks.bricks(), grid_->scale, grid_->min_weight());
}

double SurfaceModel::voxel_m() const { return grid_->scale.voxel_m; }

size_t SurfaceModel::voxels() const {
  const std::vector<Brick> bricks = grid_->bricks.bricks();
  std::vector<size_t> counts(bricks.size());
  for_each(bricks.size(), [&](size_t i) {
    const int64_t* const voxels = bricks[i].voxels;
    counts[i] = static_cast<size_t>(std::count_if(
        voxels, voxels + kBrickVoxels, [](int64_t voxel) { return voxel_weight(static_cast<uint64_t>(voxel)) > 0; }));
  });
  return std::accumulate(counts.begin(), counts.end(), size_t{0});
}

size_t SurfaceModel::memory_bytes() const { return grid_->bricks.memory_bytes(); }

}  // namespace fringeslam
