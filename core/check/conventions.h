// SPDX-License-Identifier: Apache-2.0
// Checks whether the described conventions of a rig (phase shifts, periods, Gray codes, calibration) fit its images, by
// comparing the description with alternatives that differ in one convention (docs/method.md, section 11.5).
//
// A wrong convention usually still decodes to smooth surfaces. Redundant measurements reveal it:
//
//   orientation  a surface seen by the camera and lit by the projector faces both; a wrong shift_sign turns it away
//   range        depths lie in the working range, in front of the camera and within the projector's image
//   periods      the phases of two periods, or a phase and the edges of a Gray code, agree on average
//   center       the optical axis passes near the middle of the image
//   epipolar     with both axes coded, (u, v) lies on the pixel's epipolar line; without a calibration, the map from
//                camera to projector at least preserves orientation
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// A description of a rig that may apply to images.
struct RigDescription {
  std::string change;  // how it differs from the stated description, such as "shift_sign: -1"
  PatternSequence sequence;
  RigModel rig;
};

// Difference between the phases of two periods, or of fringes and the edges of a Gray code, which is 0 on average if they
// are described correctly.
struct Agreement {
  double concentration = std::numeric_limits<double>::quiet_NaN();  // length of the mean phasor, 0 to 1; NaN: no test
  double offset_deg = 0;                                            // its angle
};

// How well images fit a description. Fractions are of the lit pixels; NaN where the patterns or a missing calibration
// do not allow the test.
struct DescriptionFit {
  int lit = 0;           // number of lit pixels examined
  double ordered = 0;    // with a fringe order
  double in_range = 0;   // between near_m and far_m and within the projector's image
  double facing = 0;     // of those with a depth: on a surface that faces camera and projector
  double plausible = 0;  // all of it
  // Where the principal points lie, as a fraction of the image width. That of the projector's rows is left out, since
  // projectors shift their lens vertically.
  double camera_center = 0, projector_center = 0;
  double median_depth_m = 0;
  double epipolar_px = 0;  // median distance between the decoded and the epipolar row
  Agreement agreement;     // the worst of all pairs
};

// Result of comparing a description with its alternatives.
struct ConventionReport {
  enum class Verdict { fits, doubtful, wrong } verdict = Verdict::fits;
  DescriptionFit stated;
  std::string better;   // the change that fits best, if it fits better than the stated description
  DescriptionFit best;  // its fit
  std::string message;  // one line that explains a verdict other than `fits`
};

// Decodes a stack as described and evaluates the result. Throws Error if the patterns cannot be decoded that way.
DescriptionFit fit_of(const FringeStack& stack, const RigDescription& description);

// Returns the descriptions that differ from the given one by a common mistake. `offset_rad` holds, for each pattern, the
// phase shift of step 0 of its period.
std::vector<RigDescription> alternative_descriptions(const PatternSequence& sequence, const RigModel& rig,
                                                     const std::vector<double>& offset_rad);

// Compares a description with its alternatives, and with combinations of two if it hardly fits. Throws Error if
// the stack cannot be decoded as described.
ConventionReport check_conventions(const FringeStack& stack, const RigModel& rig,
                                   const std::vector<double>& offset_rad);

// Explains in one line that a stack's surfaces face away from the projector, because its images are mirrored left to right or
// rotated by half a turn. Empty if they face it, or if the stack cannot be decoded by itself.
std::string reason_for_turned_images(const FringeStack& stack, const RigModel& rig);

// Explains in one line why a stack yields no depth between near_m and far_m.
std::string reason_for_no_depth(const FringeStack& stack, const RigModel& rig);

}  // namespace fringeslam
