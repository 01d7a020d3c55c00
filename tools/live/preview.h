// SPDX-License-Identifier: Apache-2.0
// Quick feedback on a stack for the operator: is it bright enough, not overexposed, and does it yield depth?
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
  double valid = 0;               // fraction of the pixels that have depth
  double saturated = 0;           // fraction of the pixels that decoding rejects as clipped in at least one image
  double mean_modulation_dn = 0;  // I'' of the finest fringes
  double brightness = 0;          // mean over the pixels of the brightest sample / full scale
  double full_scale_dn = 255;
  bool depth_possible = true;  // false: these patterns determine no fringe orders
};

// All images have the camera's size.
struct Preview {
  cv::Mat1b texture;     // white: kTextureWhite of full scale
  cv::Mat1b modulation;  // white: fringes from black to full scale
  cv::Mat3b saturation;  // BGR: each pixel's brightest sample, red where clipped
  cv::Mat1b depth;       // encoded like depth_image(): 255 (near_m) to 1 (far_m); 0 where there is none
  PreviewFigures figures;
};

// The mean of fringes just below clipping is about half of full scale.
inline constexpr double kTextureWhite = 0.6;

// Throws Error if the stack does not match the sequence or the rig. Without fringe orders the depth is empty.
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig);

// Prepares the most expensive part, which is the same for all stacks of a sequence; empty if the sequence yields no
// depth. The second function uses it.
std::optional<Triangulation> preview_triangulation(const PatternSequence& sequence, const RigModel& rig);
Preview preview_of(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                   const std::optional<Triangulation>& triangulation);

// Previews a stack that the pipeline decoded. `texture` (full scale 255) and `depth` are the frame's.
Preview preview_of(const FringeStack& stack, const RigModel& rig, const cv::Mat1b& texture,
                   const cv::Mat1f& modulation_dn, const cv::Mat1b& depth);

// Returns advice for the operator, one sentence each.
std::vector<std::string> warnings(const PreviewFigures& figures);

// Decodes mean and modulation of the finest fringes only, for sequences without fringe orders: no coordinate is valid.
DecodedStack decode_without_orders(const FringeStack& stack, const RigModel& rig, Axis axis);

}  // namespace fringeslam::tools
