// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/decode/decode.h"
#include "core/types/error.h"

namespace fringeslam::tools {

// Throws Error if depth cannot be measured with this rig and pattern sequence.
inline void check_mappable(const RigModel& rig, const PatternSequence& sequence, DecodeOptions options) {
  if (!rig.calibrated) throw Error("its rig is not calibrated, so there is no depth; run fringeslam calibrate rig");
  if (options.unwrapping == Unwrapping::predicted)
    options.unwrapping = Unwrapping::automatic;  // the first view has no map
  resolve_unwrapping(sequence, rig, options);
}

}  // namespace fringeslam::tools
