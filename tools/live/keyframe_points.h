// SPDX-License-Identifier: Apache-2.0
// What a keyframe adds to the live map: some of its points in its camera's frame, so that a correction of the map moves
// them by their keyframe's pose alone.
//
//   uint32  count
//   float32 step_m, sigma_step_m
//   int16   x y z of each point, times step_m
//   uint8   grey of each point
//   uint8   sigma of each point's depth, times sigma_step_m; 255: that or more
//
// Little-endian, without gaps.
#pragma once

#include <string>

#include "core/map/stored_frame.h"

namespace fringeslam::tools {

inline constexpr int kKeyframePoints = 10000;  // at most
inline constexpr double kSigmaStepM = 2e-6;

// Pixels on a square grid, as dense as `most` allows. `rays`: of the camera.
std::string keyframe_points(const StoredFrame& frame, const PixelRays& rays, int most = kKeyframePoints);

}  // namespace fringeslam::tools
