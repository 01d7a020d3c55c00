// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/conveyor.h"

#include <utility>

namespace fringeslam {

Conveyor::Ahead Conveyor::look(const PatternSequence& patterns) const {
  std::optional<FringeStack> stack = rig_.capture(patterns);
  if (!stack) return std::nullopt;
  return pipeline_.see_ahead(std::move(*stack));
}

std::optional<Conveyor::View> Conveyor::next() {
  Ahead seen = ahead_.valid() ? ahead_.get() : look(pipeline_.next_patterns());
  if (!seen) return std::nullopt;
  // A copy: what the pipeline wants next may change while the rig is at work.
  if (pipeline_.knows_patterns_ahead())
    ahead_ = std::async(std::launch::async, [this, patterns = pipeline_.next_patterns()] { return look(patterns); });
  FringeStack stack = seen->stack;  // shares its images
  FrameResult result = pipeline_.process(std::move(*seen));
  return View{std::move(stack), std::move(result)};
}

}  // namespace fringeslam
