// SPDX-License-Identifier: Apache-2.0
// How sharp a rig's two lenses are, from fine fringes with white and black.
//
// In focus, fringes reach from the scene's black K to its white W: their modulation I'' is (W - K) / 2. A lens out of
// focus spreads each point; a Gaussian of standard deviation s px leaves of fringes of period p px the share
//
//   contrast = I'' / ((W - K) / 2) = exp(-2 pi^2 s^2 / p^2)
//
// which both lenses reduce, the projector's and the camera's. The scene's own texture is sharp by the camera's lens
// alone: its sharpness is the root mean square of the gradient of I' over the mean of I', per pixel. A level of
// light that does not change cancels in the first, a factor in both.
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam::tools {

struct FocusReading {
  // Contrast, 1 in focus; NaN where hardly a pixel can tell white from black. Of the 3 x 3 grid's cells the middle one
  // and the mean of those in the corners.
  double fringes = 0, centre = 0, corners = 0;
  double sharpness = 0;  // of the texture, 1/px
  double measured = 0;   // share of the pixels that can tell
};

// Fringes along the columns, four steps, then white and black.
PatternSequence focus_sequence(const RigModel& rig, double period_px);

// Throws Error when the sequence lacks fringes, white or black, or the stack does not fit it.
FocusReading read_focus(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig);

}  // namespace fringeslam::tools
