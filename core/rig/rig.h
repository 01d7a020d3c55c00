// SPDX-License-Identifier: Apache-2.0
// Interface between image sources and the pipeline, implemented by sim::VirtualRig, ReplayRig, RecordingRig and others.
// Its unit is a whole pattern sequence, not a single image, so that synchronisation stays inside the rig.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam {

class Rig {
 public:
  virtual ~Rig() = default;
  virtual const RigModel& model() const = 0;
  // Returns the camera images of one pass through the sequence; empty at the end of the recording or scene.
  virtual std::optional<FringeStack> capture(const PatternSequence& sequence) = 0;
  // True if the next stack may show other patterns than the last one without loss: false for recordings, and where
  // stacks are captured ahead.
  virtual bool can_change_patterns() const { return true; }
  // Files and folders that capture() reads, which a recording of this rig must not replace.
  virtual std::vector<std::filesystem::path> inputs() const { return {}; }
};

}  // namespace fringeslam
