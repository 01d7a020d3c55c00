// SPDX-License-Identifier: Apache-2.0
// What one frame says of the voxels near its surface (after Curless and Levoy, A volumetric method for building complex
// models from range images, 1996). A voxel v (camera frame) belongs to the pixel that it projects on, through the lens'
// distortion; of that pixel's point p, unit normal n and viewing ray r = p / z it takes
//
//   d = n . (v - p)                      distance, positive on the camera's side
//   w = 1 / ((n . r)^2 sigma_z^2 + s^2)  weight; s guards against sigmas too small to be true
//
// and is averaged: D' = D + (d - D) w / (W + w), W' = W + w; the grey value alike. Only |d| < truncation is written.
//
// The distance is that to the pixel's tangent plane, not the difference of depths: a voxel lies up to half a pixel off
// the pixel's ray, where the depth has changed by slope * footprint / 2. To the plane it is exact wherever the surface
// is flat, and no depth is interpolated, so nothing is made up across a step. A pixel without a normal sees an edge, or
// is too close to one for a window of its own: it takes the normal of the neighbour on whose plane it lies best, within
// the noise of both, else it is left out. So are pixels that look along their surface.
//
// Space in front of the band stays unwritten: free space beside an outline would meet the voxels behind the outline,
// and the model would close every shadow with a wall.
#pragma once

#include <vector>

#include "core/map/surface_bricks.h"
#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// A brick that a frame touches, and which of its eight octants of 4 x 4 x 4 voxels: bit 4 x + 2 y + z.
struct TouchedBrick {
  uint64_t key = 0;
  uint8_t octants = 0;
};

// Touched bricks in the order of their first insertion.
class BrickSet {
 public:
  void clear();
  void insert(const TouchedBrick& brick);
  const std::vector<TouchedBrick>& bricks() const { return bricks_; }

 private:
  void grow();
  std::vector<TouchedBrick> bricks_;
  std::vector<uint32_t> slots_;  // a slot holds a brick's number + 1, or 0
};

// What voxels take from a pixel, in one load: grey value and normal are in steps of 1 and of 1/32767. The plane's
// offset is that of the rounded normal, so that the plane holds the pixel's point.
struct alignas(16) PixelPlane {
  uint32_t normal_xy;  // x in the lower half
  uint32_t normal_z_grey;
  float offset_m;  // n . p; NaN: of no use
  float weight;    // 1/m^2
};

class FrameFusion {
 public:
  FrameFusion(const Pinhole& camera, const VoxelScale& scale, double max_slope_deg, double min_sigma_m,
              double max_off_plane_sigma);

  // Takes in a frame. Returns the bricks about its points that its band reaches, and some that only border on it; their
  // order depends on the frame and its pose alone. Pixels that see more than a hundred voxels at once touch none.
  const std::vector<TouchedBrick>& begin(const Frame& frame, const Pose& world_from_camera);

  // Fuses that frame into the voxels of a brick that it touches. Whether any of them was in its band.
  bool fuse(const TouchedBrick& brick, int64_t* voxels, InstructionSet set = widest_instruction_set()) const;

 private:
  Pinhole camera_;
  VoxelScale scale_;
  float min_slope_cos_, min_variance_, max_off_plane_sigma_;
  Pose camera_from_world_;
  std::vector<PixelPlane> pixels_;
  std::vector<BrickSet> rows_;
  BrickSet bricks_;
};

}  // namespace fringeslam
