// SPDX-License-Identifier: Apache-2.0
// A keyframe's contribution to the live map: a subset of its points in its camera's frame, so that map corrections only
// need to update the keyframe's pose.
//
//   uint32  count
//   float32 step_m, sigma_step_m
//   int16   x y z of each point, times step_m
//   uint8   grey level of each point
//   uint8   sigma of each point's depth, times sigma_step_m; 255: that or more
//
// Little-endian, without gaps.
#pragma once

#include <string>

#include "core/map/stored_frame.h"

namespace fringeslam::tools {

inline constexpr int kKeyframePoints = 10000;  // at most
inline constexpr double kSigmaStepM = 2e-6;

// Encodes the valid pixels of the densest square grid with at most `most` nodes. `rays` are the camera's.
std::string keyframe_points(const StoredFrame& frame, const PixelRays& rays, int most = kKeyframePoints);

}  // namespace fringeslam::tools
