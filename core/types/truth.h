// SPDX-License-Identifier: Apache-2.0
// Exact knowledge about one simulated view. Written beside the frames by sim, read by core/score and
// by nothing else. In files it is one EXR with the channels named below.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam {

// What a pixel sees, and what the projector's light does there; bit field.
enum TruthMask : int {
  kTruthSurface = 1,   // the pixel's central ray meets a surface
  kTruthInBeam = 2,    // the point lies in the projector's image area
  kTruthInShadow = 4,  // another surface is between the point and the projector
  kTruthMixed = 8,     // the pixel's area holds an edge: its samples differ in object, in light, or by 30 degrees
  kTruthVictim = 16,   // the surface is part of a victim
  kTruthThermal = 32,  // the thermal camera sees the point
};

// Fringe order of a period: how many whole periods lie before the point, floor(Phi / 2 pi).
struct TruthOrder {
  bool columns = true;  // the axis that is coded
  double period_px = 0;
  cv::Mat1f order;
};

// All images H x W, for the ray through the pixel's centre; NaN where it meets nothing.
struct TruthFrame {
  int index = 0;
  double timestamp_s = 0;
  Pose world_from_robot;
  cv::Mat1f depth_m;                      // camera z                                       channel depth_m
  cv::Mat3f position_m;                   // world                                          channels position.x .y .z
  cv::Mat3f normals;                      // unit, camera frame, facing the camera          channels normal.x .y .z
  cv::Mat1f object_id;                    // from 1, in the order of the scene; 0: nothing  channel object_id
  cv::Mat1f projector_column;             // px; NaN out of the beam                        channel projector_column
  cv::Mat1f projector_row;                // px; NaN out of the beam                        channel projector_row
  cv::Mat1f temperature_c;                // of the surface                                 channel temperature_c
  cv::Mat1f mask;                         // sum of TruthMask bits                          channel mask
  std::vector<TruthOrder> fringe_orders;  // of every period shown; NaN out of the beam
                                          // channels fringe_order.columns.16.5 and the like
};

}  // namespace fringeslam
