// SPDX-License-Identifier: Apache-2.0
// Prepares a frame for fusion into the surface model: each pixel's tangent plane and weight, and the bricks of voxels
// within the truncation band of its points (see surface_fusion.h).
//
// A pixel without a normal sees an edge, or is too close to one for a complete window: it takes the normal of the
// neighbour whose plane it fits best within the noise of both, else it is ignored, as are pixels viewed at a grazing
// angle.
#pragma once

#include <vector>

#include "core/map/surface_bricks.h"
#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// A brick touched by frames; octant (x, y, z) of 4 x 4 x 4 voxels is bit 8 n + 4 x + 2 y + z for frame n.
struct TouchedBrick {
  uint64_t key = 0, octants = 0;
};
constexpr int kMaxFusedFrames = 8;

// Touched bricks in the order of their first insertion.
class BrickSet {
 public:
  void clear();
  void insert(const TouchedBrick& brick);
  const std::vector<TouchedBrick>& bricks() const { return bricks_; }

 private:
  void grow();
  std::vector<TouchedBrick> bricks_;
  std::vector<uint32_t> slots_;             // hash slot: brick number + 1, or 0
  std::array<TouchedBrick, 256> recent_{};  // cache of recent insertions, by hash
};

// Data that voxels read from a pixel, in a single load: normal in steps of 1/32767, grey value in steps of 1. The
// plane's offset refers to the rounded normal, so that the plane contains the pixel's point.
constexpr float kNormalSteps = 32767;
struct alignas(16) PixelPlane {
  uint32_t normal_xy;  // x in the lower half
  uint32_t normal_z_grey;
  float offset_m;  // n . p; NaN if unusable
  float weight;    // 1/m^2
};

struct PlaneLimits {
  double max_slope_deg = 80, min_sigma_m = 1e-6, max_off_plane_sigma = 2.5;
};

class FramePlanes {
 public:
  FramePlanes(const Pinhole& camera, const VoxelScale& scale, const PlaneLimits& limits);

  // Prepares a frame of the camera's size, replacing the previous one.
  void take(const Frame& frame, const Pose& world_from_camera);

  // Inserts the bricks touched by the frame's band, and some that merely border on it, as those of frame `number`;
  // their order depends on the frame and its pose only. Pixels with a footprint so large that they reach more than 32
  // octants are skipped.
  void collect(int number, BrickSet& bricks) const;

  const Pinhole& camera() const { return camera_; }
  const VoxelScale& scale() const { return scale_; }
  const Pose& camera_from_world() const { return camera_from_world_; }
  // (H + 2) x (W + 2), row-major: the image with a border of unusable pixels.
  const PixelPlane* planes() const { return planes_.data(); }
  int stride() const { return camera_.width + 2; }

 private:
  Pinhole camera_;
  VoxelScale scale_;
  PlaneLimits limits_;
  Pose camera_from_world_;
  std::vector<PixelPlane> planes_;
  std::vector<BrickSet> bands_;
};

}  // namespace fringeslam
