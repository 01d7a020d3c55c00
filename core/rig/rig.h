// SPDX-License-Identifier: Apache-2.0
// The seam between where images come from and what is done with them. sim::VirtualRig, ReplayRig and
// RecordingRig implement it. It is cut at the whole pattern sequence, never at a single image, so that
// synchronisation stays inside the rig.
#pragma once

#include <optional>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam {

class Rig {
 public:
  virtual ~Rig() = default;
  virtual const RigModel& model() const = 0;
  // The camera images of one pass through the sequence; empty when there is nothing more to see.
  virtual std::optional<FringeStack> capture(const PatternSequence& sequence) = 0;
};

}  // namespace fringeslam
