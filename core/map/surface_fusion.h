// SPDX-License-Identifier: Apache-2.0
// What frames say of the voxels near their surface (after Curless and Levoy, A volumetric method for building complex
// models from range images, 1996). A voxel v (camera frame) belongs to the pixel that it projects on, through the lens'
// distortion; of that pixel's point p, unit normal n and viewing ray r = p / z it takes
//
//   d = n . (v - p)                      distance, positive on the camera's side
//   w = 1 / ((n . r)^2 sigma_z^2 + s^2)  weight; s guards against sigmas too small to be true
//
// and holds their mean, D = sum(w d) / W, W = sum(w); the grey value alike. Only |d| < truncation is taken.
//
// The distance is that to the pixel's tangent plane, not the difference of depths: a voxel lies up to half a pixel off
// the pixel's ray, where the depth has changed by slope * footprint / 2. To the plane it is exact wherever the surface
// is flat, and no depth is interpolated, so nothing is made up across a step.
//
// Octants of a brick are looked up as a whole: within one, projection and distortion are taken as linear, which at 4
// voxels of a pixel's footprint is right to some hundredths of a pixel. What is nearer to the camera than 4 voxels is
// left out.
//
// Space in front of the band stays unwritten: free space beside an outline would meet the voxels behind the outline,
// and the model would close every shadow with a wall.
#pragma once

#include "core/map/frame_planes.h"

namespace fringeslam {

// Adds up to kFramesTogether frames to the voxels of a brick that they touch: bit 8 n and the seven above of
// `brick.octants` are those of frames[n]. Whether any voxel was in the band of any.
bool fuse(const std::vector<FramePlanes>& frames, const TouchedBrick& brick, int64_t* voxels,
          InstructionSet set = widest_instruction_set());

}  // namespace fringeslam
