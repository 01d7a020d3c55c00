// SPDX-License-Identifier: Apache-2.0
// Ground truth of one simulated view, in files one EXR with the channels named below. Written with the frames by sim
// and read only by core/score.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/types/trajectory.h"

namespace fringeslam {

// Visibility and illumination of a pixel, bit field.
enum TruthMask : int {
  kTruthSurface = 1,   // the pixel's central ray meets a surface
  kTruthInBeam = 2,    // the point lies in the projector's field
  kTruthInShadow = 4,  // another surface occludes the point from the projector
  // The pixel footprint contains an edge: samples differ in object or lighting, by 30 degrees, or by more than three
  // footprints in their distance from the tangent plane.
  kTruthMixed = 8,
  kTruthVictim = 16,   // the surface belongs to a victim
  kTruthThermal = 32,  // the thermal camera sees the point
};

// True for pixels on a surface that the projector lights, away from edges.
constexpr bool is_lit_surface(int mask) {
  return (mask & kTruthSurface) && (mask & kTruthInBeam) && !(mask & (kTruthInShadow | kTruthMixed));
}

// Fringe order for one period: the number of whole periods before the point, floor(Phi / 2 pi).
struct TruthOrder {
  bool columns = true;  // the coded axis
  double period_px = 0;
  cv::Mat1f order;
};

// All images are H x W, evaluated on the ray through the pixel centre; NaN where it hits no surface.
struct TruthFrame {
  int index = 0;
  double timestamp_s = 0;
  Pose world_from_robot;
  Trajectory exposures;  // robot pose at the middle of each image's exposure; written to truth/exposures.tum
  cv::Mat1f depth_m;                      // camera z                                       channel depth_m
  cv::Mat3f position_m;                   // world frame                                    channels position.x .y .z
  cv::Mat3f normals;                      // unit, camera frame, facing the camera          channels normal.x .y .z
  cv::Mat1f object_id;                    // from 1, in scene order; 0: none                channel object_id
  cv::Mat1f projector_column;             // px; NaN outside the projector's field          channel projector_column
  cv::Mat1f projector_row;                // px; NaN outside the projector's field          channel projector_row
  cv::Mat1f temperature_c;                // of the surface                                 channel temperature_c
  cv::Mat1f mask;                         // sum of TruthMask bits                          channel mask
  cv::Mat1f indirect_share;               // of the projector's light: sent by other        channel indirect_share
                                          // surfaces or from below this one, mean over the patterns; NaN without light.
                                          // Empty if there is no such light, and in motion; measured over the pixel
  std::vector<TruthOrder> fringe_orders;  // of every period shown; NaN outside the projector's field
                                          // channels fringe_order.columns.16.5 etc.
};

}  // namespace fringeslam
