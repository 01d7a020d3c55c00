// SPDX-License-Identifier: Apache-2.0
// The surface that all frames saw, as a truncated signed distance function in OpenVDB's sparse grid (METHOD S23;
// Museth, VDB: high-resolution sparse volumes with dynamic topology, 2013). surface_fusion.h says what a frame adds to
// it, surface_nets.h how it becomes triangles, surface_bricks.h what is stored.
#pragma once

#include <memory>
#include <vector>

#include "core/map/keyframe_map.h"
#include "core/map/surface_mesh.h"
#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pose.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct SurfaceOptions {
  double voxel_m = 0;
  double truncation_voxels = 3;
  double max_slope_deg = 80;
  double max_off_plane_sigma = 2.5;
  double min_sigma_m = 1e-6;
  double max_sigma_m = 1e-3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("voxel_m", voxel_m, {0, 1}, "edge of a voxel, m; 0: what a pixel of the camera sees amid its range");
    // Cells on the surface reach sqrt(3) voxels from it.
    v.field("truncation_voxels", truncation_voxels, {1.8, 16}, "distance from the surface that is written, voxels");
    v.field("max_slope_deg", max_slope_deg, {1, 89}, "largest angle between a pixel's ray and normal that is used");
    v.field(
        "max_off_plane_sigma", max_off_plane_sigma, {0, 10},
        "pixels without a normal, beside edges, take a neighbour's within so many sigmas of whose plane they lie; 0: "
        "they are left out");
    v.field("min_sigma_m", min_sigma_m, {1e-9, 1}, "standard deviation that is added to each pixel's, m");
    v.field("max_sigma_m", max_sigma_m, {1e-9, 1}, "largest standard deviation of what becomes a triangle, m");
  }
};

struct PosedFrame {
  Frame frame;
  Pose world_from_camera;
};

class SurfaceModel {
 public:
  // Throws Error when options are out of range.
  SurfaceModel(const RigModel& rig, const SurfaceOptions& options);
  ~SurfaceModel();
  SurfaceModel(SurfaceModel&&) noexcept;
  SurfaceModel& operator=(SurfaceModel&&) noexcept;

  // Fuses what frames of the rig's camera saw; several at once take less time. Their order, and which are added at
  // once, matter by rounding alone, and the number of threads not at all. Throws Error when a frame is not of the
  // camera's size, or its pose not within the model's reach (a million bricks of voxels from the origin).
  void add(const std::vector<PosedFrame>& frames);
  void add(const Frame& frame, const Pose& world_from_camera) { add({{frame, world_from_camera}}); }

  SurfaceMesh mesh() const;

  double voxel_m() const;
  size_t voxels() const;        // that were observed
  size_t memory_bytes() const;  // of the grid

 private:
  class Grid;
  std::unique_ptr<Grid> grid_;
};

// Of all frames of the map, where they are now known to be.
SurfaceModel surface_of(const KeyframeMap& map, const SurfaceOptions& options);

}  // namespace fringeslam
