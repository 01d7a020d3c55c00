// SPDX-License-Identifier: Apache-2.0
// High dynamic range: combines the images that a stack has of each pattern at several exposures.
//
// With e the exposure relative to the rig's, an unsaturated grey value is y = offset + e r + noise of variance
// v = c + K e max(r, 0) (EMVA 1288). Least squares over all of them, r = sum(e (y - offset) / v) / sum(e^2 / v), has the
// variance 1 / sum(e^2 / v). Images of one pattern enter the phase only through r, so weighted least squares over
// (r, variance) of all patterns equals weighted least squares over all samples (docs/method.md, section 3.1).
#pragma once

#include <vector>

#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct CombinedExposures {
  FringeStack stack;                    // one CV_32FC1 image per pattern, offset + r, DN at the rig's exposure
  std::vector<cv::Mat1f> variance_dn2;  // of each image
  double longest = 1;                   // exposure, relative to the rig's
  // Grey values of `stack` lie below, except where all exposures of a pattern are saturated.
  float clip_dn = 0;
};

// Combines the exposures of each pattern. A sample at or above `clip_dn` is not used, nor one that shorter exposures
// predict to be. Throws Error if an exposure time is not positive.
CombinedExposures combine_exposures(const FringeStack& stack, const SensorModel& sensor, double clip_dn);

// Returns the exposure of a stack, relative to the rig's, with the greatest contrast of unsaturated pixels.
double clearest_exposure(const FringeStack& stack, double clip_dn);

// Returns the images of a stack at one of its exposures. They are a stack of fewer images in a linear relation to the light.
FringeStack images_at(const FringeStack& stack, double exposure);

// Returns the images at the clearest exposure.
FringeStack best_exposure(const FringeStack& stack, double clip_dn);

// Returns a stack of a single exposure as if that were the rig's.
FringeStack as_one_exposure(FringeStack stack);

// Reduces stacks of the same patterns to one exposure, for functions that assume equal exposures.
class OneExposure {
 public:
  // Gray values from `clip_dn` on are saturated.
  explicit OneExposure(double clip_dn) : clip_dn_(clip_dn) {}
  // Returns the images at the clearest exposure of the first stack of these patterns, as if that were the rig's.
  FringeStack of(const FringeStack& stack);

 private:
  double clip_dn_;
  PatternSequence patterns_;  // for which the exposure was chosen
  double exposure_ = 1;
};

}  // namespace fringeslam
