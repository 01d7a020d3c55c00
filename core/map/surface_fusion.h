// SPDX-License-Identifier: Apache-2.0
// Fusion of frames into the voxels near their surface (after Curless and Levoy, A volumetric method for building
// complex models from range images, 1996). A voxel v (camera frame) is assigned to the pixel that it projects onto,
// including the lens distortion; with that pixel's point p, unit normal n and viewing ray r = p / z it takes
//
//   d = n . (v - p)                      distance, positive on the camera's side
//   w = 1 / ((n . r)^2 sigma_z^2 + s^2)  weight; s guards against sigmas that are too small
//
// and stores their mean, D = sum(w d) / W, W = sum(w), and likewise the grey value. Only |d| < truncation is used.
//
// The distance is that to the pixel's tangent plane, not a difference of depths: a voxel lies up to half a pixel off
// the pixel's ray, where the depth differs by slope * footprint / 2. For flat surfaces the distance to the plane is
// exact, and no depth is interpolated, so nothing is invented across a step.
//
// Octants of a brick are projected as a whole: projection and distortion are linearised within an octant, which is
// accurate to a few hundredths of a pixel for 4 voxels of one pixel's footprint each. Octants closer to the camera
// than 4 voxels are skipped.
//
// Free space in front of the band is not written: beside an occluding contour it would meet the voxels behind the
// contour, and the model would close every shadow with a wall.
#pragma once

#include "core/map/frame_planes.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

// Adds up to kFramesTogether frames to the voxels of a brick; bits 8 n to 8 n + 7 of `brick.octants` belong to
// frames[n]. Returns whether any voxel was in the band of any frame.
bool fuse(const std::vector<FramePlanes>& frames, const TouchedBrick& brick, int64_t* voxels,
          InstructionSet set = selected_instruction_set());

}  // namespace fringeslam
