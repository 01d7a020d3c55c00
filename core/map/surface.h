// SPDX-License-Identifier: Apache-2.0
// The surface fused from all frames, a truncated signed distance function in OpenVDB's sparse grid (docs/method.md,
// section 8.2; Museth, VDB: high-resolution sparse volumes with dynamic topology, 2013). See surface_fusion.h for the
// fusion, surface_nets.h for the triangulation, surface_vdb.h for the export, surface_bricks.h for the storage.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/map/keyframe_map.h"
#include "core/map/map_tiles.h"
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
    v.field("voxel_m", voxel_m, {0, 1}, "edge length of a voxel, m; 0: a pixel's footprint at mid range");
    // Cells on the surface extend up to sqrt(3) voxels from it.
    v.field("truncation_voxels", truncation_voxels, {1.8, 16},
            "half width of the band around the surface that is written, voxels");
    v.field("max_slope_deg", max_slope_deg, {1, 89}, "largest usable angle between a pixel's ray and normal, degrees");
    v.field("max_off_plane_sigma", max_off_plane_sigma, {0, 10},
            "a pixel without a normal, next to an edge, takes the normal of a neighbour whose plane it fits within "
            "this many sigmas; 0: it is ignored");
    v.field("min_sigma_m", min_sigma_m, {1e-9, 1}, "standard deviation added in quadrature to each pixel's, m");
    v.field("max_sigma_m", max_sigma_m, {1e-9, 1}, "largest standard deviation of voxels that are triangulated, m");
  }
};

struct PosedFrame {
  Frame frame;
  Pose world_from_camera;
};

class SurfaceModel {
 public:
  // Throws Error if options are out of range.
  SurfaceModel(const RigModel& rig, const SurfaceOptions& options);
  ~SurfaceModel();
  SurfaceModel(SurfaceModel&&) noexcept;
  SurfaceModel& operator=(SurfaceModel&&) noexcept;

  // Fuses frames of the rig's camera; several frames per call take less time. Their order and grouping affect the
  // result by rounding only, the number of threads not at all. Throws Error if a frame does not have the camera's
  // size, or a pose is out of the model's range (about 524,000 bricks from the origin along each axis).
  void add(const std::vector<PosedFrame>& frames);
  void add(const Frame& frame, const Pose& world_from_camera) { add({{frame, world_from_camera}}); }

  // Triangulates the surface where its standard deviation is at most max_sigma_m.
  SurfaceMesh mesh() const;

  // Returns the signed distances that mesh() triangulates as a .vdb file (surface_vdb.h).
  std::string to_vdb() const;

  double voxel_m() const;
  size_t voxels() const;        // observed voxels
  size_t memory_bytes() const;  // of the grid

 private:
  class Grid;
  void add_frames(const KeyframeMap& map, const std::vector<size_t>& frames);
  friend SurfaceModel surface_of(const KeyframeMap& map, const SurfaceOptions& options);
  friend void for_each_surface_part(const KeyframeMap& map, const SurfaceOptions& options,
                                    const std::function<void(const SurfaceMesh&)>& take, const TileProgress& progress);
  std::unique_ptr<Grid> grid_;
};

// Fuses all frames of the map at their current poses, one tile (map_tiles.h) at a time, and passes the parts of the mesh
// to `take`. A part's triangles refer to the vertices of all parts so far, numbered in their order.
void for_each_surface_part(const KeyframeMap& map, const SurfaceOptions& options,
                           const std::function<void(const SurfaceMesh&)>& take, const TileProgress& progress = {});

// Fuses all frames of the map at their current poses.
SurfaceModel surface_of(const KeyframeMap& map, const SurfaceOptions& options);

}  // namespace fringeslam
