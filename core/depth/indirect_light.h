// SPDX-License-Identifier: Apache-2.0
// Error of the coordinate due to light that comes from nearby surfaces. Light from farther than a few periods averages out
// over the fringes. Light that surfaces beside a crease reflect onto each other does not, and no combination of fringe
// periods distinguishes it from a displacement (docs/method.md, section 4.4).
#pragma once

#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Returns the coordinate's standard deviation due to bounces between diffuse surfaces of this albedo, px: a quarter of
// the largest error at any phase of the light. H x W; 0 where there is no depth. `frame` needs points and normals, and
// `decoded` the coordinate and modulation of its pixels.
cv::Mat1f indirect_sigma_px(const Frame& frame, const DecodedStack& decoded, const RigModel& rig, double albedo);

}  // namespace fringeslam
