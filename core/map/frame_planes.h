// SPDX-License-Identifier: Apache-2.0
// A frame as the voxels of the surface model want it: each pixel's tangent plane and weight, and the bricks of voxels
// about its points that its band reaches (surface_fusion.h says what for).
//
// A pixel without a normal sees an edge, or is too close to one for a window of its own: it takes the normal of the
// neighbour on whose plane it lies best, within the noise of both, else it is left out. So are pixels that look along
// their surface.
#pragma once

#include <vector>

#include "core/map/surface_bricks.h"
#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// A brick that frames touch, and which of its eight octants of 4 x 4 x 4 voxels: frame n its bit 8 n + 4 x + 2 y + z.
struct TouchedBrick {
  uint64_t key = 0, octants = 0;
};
constexpr int kFramesTogether = 8;

// Touched bricks in the order of their first insertion.
class BrickSet {
 public:
  void clear();
  void insert(const TouchedBrick& brick);
  const std::vector<TouchedBrick>& bricks() const { return bricks_; }

 private:
  void grow();
  std::vector<TouchedBrick> bricks_;
  std::vector<uint32_t> slots_;             // a slot holds a brick's number + 1, or 0
  std::array<TouchedBrick, 256> recent_{};  // by the hash, some of the last that were inserted
};

// What voxels take from a pixel, in one load: grey value and normal are in steps of 1 and of 1/32767. The plane's
// offset is that of the rounded normal, so that the plane holds the pixel's point.
constexpr float kNormalSteps = 32767;
struct alignas(16) PixelPlane {
  uint32_t normal_xy;  // x in the lower half
  uint32_t normal_z_grey;
  float offset_m;  // n . p; NaN: of no use
  float weight;    // 1/m^2
};

struct PlaneLimits {
  double max_slope_deg = 80, min_sigma_m = 1e-6, max_off_plane_sigma = 2.5;
};

class FramePlanes {
 public:
  FramePlanes(const Pinhole& camera, const VoxelScale& scale, const PlaneLimits& limits);

  // Takes in a frame of the camera's size, in place of the one before.
  void take(const Frame& frame, const Pose& world_from_camera);

  // Inserts the bricks about its points that its band reaches, and some that only border on it, as those of frame
  // `number`; in an order that depends on the frame and its pose alone. Pixels that see more than a hundred voxels at
  // once touch none.
  void collect(int number, BrickSet& bricks) const;

  const Pinhole& camera() const { return camera_; }
  const VoxelScale& scale() const { return scale_; }
  const Pose& camera_from_world() const { return camera_from_world_; }
  // (H + 2) x (W + 2) row by row: about the image a border of no use.
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
