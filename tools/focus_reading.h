// SPDX-License-Identifier: Apache-2.0
// Measures the focus of a rig's two lenses from fine fringes and a white and a black image.
//
// In focus, the fringes span the range from the scene's black K to its white W: their modulation I'' is (W - K) / 2.
// A defocused lens blurs each point; a Gaussian blur of standard deviation s px reduces fringes of period p px to
//
//   contrast = I'' / ((W - K) / 2) = exp(-2 pi^2 s^2 / p^2)
//
// Both lenses, the projector's and the camera's, reduce the contrast. The sharpness of the scene's own texture depends
// on the camera's lens alone; it is the root mean square of the gradient of I' divided by the mean of I', per pixel.
// Constant ambient light cancels in the contrast, a scale factor of the light cancels in both.
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam::tools {

struct FocusReading {
  // Contrast, 1 in focus; NaN where too few pixels separate white from black. `centre` is the middle cell of a 3 x 3
  // grid over the image, `corners` the mean over its corner cells.
  double fringes = 0, centre = 0, corners = 0;
  double sharpness = 0;  // of the texture, 1/px
  double measured = 0;   // share of the pixels that separate white from black and are not saturated
};

// Returns four phase steps of column fringes with period `period_px` in projector px, then white and black.
PatternSequence focus_sequence(const RigModel& rig, double period_px);

// Measures contrast and sharpness. Throws Error if the patterns lack fringes, white or black, or if check_stack() does.
FocusReading read_focus(const FringeStack& stack, const RigModel& rig);

}  // namespace fringeslam::tools
