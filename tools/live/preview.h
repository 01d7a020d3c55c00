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

// Of the camera's size.
struct Preview {
  cv::Mat1b texture;     // white: kTextureWhite of full scale
  cv::Mat1b modulation;  // white: fringes from black to full scale
  cv::Mat3b saturation;  // BGR: each pixel's brightest sample, red where clipped
  cv::Mat1b depth;       // as depth_image() has it: from 255, near_m, to 1, far_m; 0 where there is none
  PreviewFigures figures;
};

// The mean of fringes that just do not clip is about half of full scale.
inline constexpr double kTextureWhite = 0.6;

// Throws Error when the stack does not fit the sequence or the rig. A sequence without depth is none.
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig);

// What takes most of the time and is the same for all stacks of a sequence; empty where it gives no depth. And a
// preview with it.
std::optional<Triangulation> preview_triangulation(const PatternSequence& sequence, const RigModel& rig);
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                   const std::optional<Triangulation>& triangulation);

// Of a stack that the pipeline decoded. `texture`, full scale 255, and `depth` are the frame's.
Preview preview_of(const FringeStack& stack, const RigModel& rig, const cv::Mat1b& texture,
                   const cv::Mat1f& modulation_dn, const cv::Mat1b& depth);

// What a person should do about it, a sentence each.
std::vector<std::string> warnings(const PreviewFigures& figures);

// Mean and modulation of the finest fringes alone, for sequences that tell no fringe orders: no coordinate is valid.
DecodedStack decode_without_orders(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                                   Axis axis);

}  // namespace fringeslam::tools
