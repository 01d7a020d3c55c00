// SPDX-License-Identifier: Apache-2.0
// What a person at the rig wants to see of a stack at once: is it bright enough, not too bright, and is there depth?
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/depth/triangulation.h"
#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam::tools {

struct PreviewFigures {
  double valid = 0;               // share of the pixels that have depth
  double saturated = 0;           // share that decoding refuses as clipped in one image or more
  double mean_modulation_dn = 0;  // I'' of the finest fringes
  double brightness = 0;          // each pixel's brightest sample over full scale, on average
  double full_scale_dn = 255;
  bool depth_possible = true;  // false: these patterns tell no fringe orders
};

// 8-bit BGR, of the camera's size.
struct Preview {
  cv::Mat3b texture;
  cv::Mat3b modulation;  // white: fringes from black to full scale
  cv::Mat3b saturation;  // each pixel's brightest sample, red where clipped
  cv::Mat3b depth;       // from near_m, blue, to far_m, red; black where there is none
  PreviewFigures figures;
};

// Throws Error when the stack does not fit the sequence or the rig. A sequence without depth is none.
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig);

// What takes most of the time and is the same for all stacks of a sequence; empty where it gives no depth. And a
// preview with it.
std::optional<Triangulation> preview_triangulation(const PatternSequence& sequence, const RigModel& rig);
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                   const std::optional<Triangulation>& triangulation);

// What a person should do about it, a sentence each.
std::vector<std::string> warnings(const PreviewFigures& figures);

// Mean and modulation of the finest fringes alone, for sequences that tell no fringe orders: no coordinate is valid.
DecodedStack decode_without_orders(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                                   Axis axis);

}  // namespace fringeslam::tools
