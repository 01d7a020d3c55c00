// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface.h"

#include <openvdb/openvdb.h>

#include <algorithm>
#include <numeric>

#include "core/base/parallel.h"
#include "core/map/surface_fusion.h"
#include "core/map/surface_nets.h"
#include "core/map/surface_vdb.h"

namespace fringeslam {

namespace {

using Tree = openvdb::Int64Tree;
using VoxelLeaf = Tree::LeafNodeType;
static_assert(VoxelLeaf::DIM == kBrickEdge);

constexpr int kTogether = 16;  // bricks per parallel task

openvdb::Coord first_voxel(const BrickIndex& brick) {
  return {kBrickEdge * brick[0], kBrickEdge * brick[1], kBrickEdge * brick[2]};
}

VoxelScale scale_of(const RigModel& rig, const SurfaceOptions& options) {
  check_options(options, "surface");
  const double pixel_m = (rig.near_m + rig.far_m) / (rig.camera.fx + rig.camera.fy);
  const double voxel_m = options.voxel_m > 0 ? options.voxel_m : pixel_m;
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
      : camera(rig.camera), scale(scale_of(rig, surface)), options(surface), tree(0) {}

  void check(const PosedFrame& posed) const;
  // Adds at most kFramesTogether frames.
  void add(const PosedFrame* first, size_t count);

  // Returns the leaves in the order of their coordinates.
  std::vector<const VoxelLeaf*> leaves() const {
    std::vector<const VoxelLeaf*> all;
    tree.getNodes(all);
    return all;
  }

  std::vector<Brick> bricks() const {
    std::vector<Brick> all;
    for (const VoxelLeaf* leaf : leaves()) {
      const openvdb::Coord& corner = leaf->origin();
      all.push_back({{corner.x() >> 3, corner.y() >> 3, corner.z() >> 3}, leaf->buffer().data()});
    }
    return all;
  }

  // Returns the smallest weight of voxels that belong to the surface.
  double min_weight() const { return 1 / (options.max_sigma_m * options.max_sigma_m); }

  Pinhole camera;
  VoxelScale scale;
  SurfaceOptions options;
  Tree tree;

 private:
  // Kept between calls, since allocating memory costs more than writing to it.
  std::vector<FramePlanes> frames;
  BrickSet touched;
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

void SurfaceModel::Grid::add(const PosedFrame* first, size_t count) {
  const PlaneLimits limits{options.max_slope_deg, options.min_sigma_m, options.max_off_plane_sigma};
  while (frames.size() < count) frames.emplace_back(camera, scale, limits);
  touched.clear();
  for (size_t i = 0; i < count; ++i) {
    frames[i].take(first[i].frame, first[i].world_from_camera);
    frames[i].collect(static_cast<int>(i), touched);
  }
  const std::vector<TouchedBrick>& bricks = touched.bricks();
  // The tree may be searched in parallel but not modified: new leaves are added at the end.
  std::vector<std::unique_ptr<VoxelLeaf>> fresh(bricks.size());
  for_each(bricks.size(), [&](size_t i) {
    const openvdb::Coord corner = first_voxel(brick_of(bricks[i].key));
    VoxelLeaf* leaf = tree.probeLeaf(corner);
    if (leaf == nullptr) {
      fresh[i] = std::make_unique<VoxelLeaf>(corner, 0);
      leaf = fresh[i].get();
    }
    const bool seen = fuse(frames, bricks[i], leaf->buffer().data());
    if (!seen) fresh[i].reset();
  });
  for (auto& leaf : fresh) {
    if (leaf) tree.addLeaf(leaf.release());
  }
}

SurfaceModel::SurfaceModel(const RigModel& rig, const SurfaceOptions& options)
    : grid_(std::make_unique<Grid>(rig, options)) {}
SurfaceModel::~SurfaceModel() = default;
SurfaceModel::SurfaceModel(SurfaceModel&&) noexcept = default;
SurfaceModel& SurfaceModel::operator=(SurfaceModel&&) noexcept = default;

void SurfaceModel::add(const std::vector<PosedFrame>& frames) {
  for (const PosedFrame& frame : frames) grid_->check(frame);
  for (size_t i = 0; i < frames.size(); i += kMaxFusedFrames)
    grid_->add(frames.data() + i, std::min<size_t>(kMaxFusedFrames, frames.size() - i));
}

SurfaceModel surface_of(const KeyframeMap& map, const SurfaceOptions& options) {
  SurfaceModel surface(map.rig(), options);
  const std::vector<MapFrame>& frames = map.frames();
  std::vector<PosedFrame> together;  // limits the memory use
  for (size_t i = 0; i < frames.size(); ++i) {
    together.push_back({restored(frames[i].frame, map.rays()), map.world_from_camera(frames[i])});
    if (together.size() < kMaxFusedFrames && i + 1 < frames.size()) continue;
    surface.add(together);
    together.clear();
  }
  return surface;
}

SurfaceMesh SurfaceModel::mesh() const { return surface_nets(grid_->bricks(), grid_->scale, grid_->min_weight()); }

std::string SurfaceModel::to_vdb() const {
  return fringeslam::to_vdb(grid_->bricks(), grid_->scale, grid_->min_weight());
}

double SurfaceModel::voxel_m() const { return grid_->scale.voxel_m; }

size_t SurfaceModel::voxels() const {
  const std::vector<const VoxelLeaf*> leaves = grid_->leaves();
  std::vector<size_t> counts(leaves.size());
  for_each(leaves.size(), [&](size_t i) {
    const int64_t* const voxels = leaves[i]->buffer().data();
    counts[i] = static_cast<size_t>(std::count_if(
        voxels, voxels + kBrickVoxels, [](int64_t voxel) { return voxel_weight(static_cast<uint64_t>(voxel)) > 0; }));
  });
  return std::accumulate(counts.begin(), counts.end(), size_t{0});
}

size_t SurfaceModel::memory_bytes() const { return grid_->tree.memUsage(); }

}  // namespace fringeslam
