// SPDX-License-Identifier: Apache-2.0
// Exact knowledge about one simulated view. Written beside the frames by sim, read by core/score and
// by nothing else. In files it is one EXR with the channels named below.
#pragma once

#include <opencv2/core.hpp>

#include "core/types/pose.h"

namespace fringeslam {

// What a pixel sees, and what the projector's light does there; bit field.
enum TruthMask : int {
  kTruthSurface = 1,   // the pixel's central ray meets a surface
  kTruthInBeam = 2,    // the point lies in the projector's image area
  kTruthInShadow = 4,  // another surface is between the point and the projector
  kTruthMixed = 8,     // the pixel's area holds an edge: its samples differ in object, in light, or by 30 degrees
};

// All images H x W, for the ray through the pixel's centre; NaN where it meets nothing.
struct TruthFrame {
  int index = 0;
  double timestamp_s = 0;
  Pose world_from_robot;
  cv::Mat1f depth_m;           // camera z                                channel depth_m
  cv::Mat3f normals;           // unit, camera frame, facing the camera   channels normal.x .y .z
  cv::Mat1f object_id;         // from 1, in the order of the scene       channel object_id
  cv::Mat1f projector_column;  // px; NaN out of the beam                 channel projector_column
  cv::Mat1f mask;              // sum of TruthMask bits                   channel mask
};

}  // namespace fringeslam
