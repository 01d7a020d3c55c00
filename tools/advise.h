// SPDX-License-Identifier: Apache-2.0
// Advice on coding, number of images and exposures for what a connected rig sees.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "core/decode/advice.h"
#include "core/rig/rig.h"

namespace fringeslam::tools {

struct RigAdvice {
  nlohmann::ordered_json document;  // as printed by fringeslam advise --json
  std::string text;
};

// Captures a stack; empty if that is impossible.
using Look = std::function<std::optional<FringeStack>(const PatternSequence&)>;

// Captures a stack of default_sequence() and advises from its images, like fringeslam advise. What is saturated there is
// captured again at shorter exposures with `look`. `path` names the rig in messages. Throws Error if the rig returns no
// stack.
RigAdvice advise_for(Rig& rig, const Look& look, const std::string& path, bool takes_exposures);

// Captures a stack of `sequence`, and others at shorter exposures with `look` where it is saturated, and returns the
// exposures that these patterns need. Throws Error like advise_for(), or if the sequence has several exposures.
ExposureChoice exposures_for(Rig& rig, const Look& look, const PatternSequence& sequence, const std::string& path);

}  // namespace fringeslam::tools
