// SPDX-License-Identifier: Apache-2.0
#include "core/types/selected_instruction_set.h"

#include <cstdlib>

namespace fringeslam {

InstructionSet chosen_instruction_set(const char* wanted, InstructionSet widest) {
  if (!wanted || !*wanted) return widest;
  std::string known;
  for (const InstructionSet set : choice_values<InstructionSet>()) {
    if (wanted == std::string(to_string(set))) {
      if (set <= widest) return set;
      throw Error(std::string(kInstructionSetVariable) + "=" + wanted +
                  ": this processor does not support it; its widest instruction set is " + to_string(widest));
    }
    known += std::string(known.empty() ? "" : ", ") + to_string(set);
  }
  throw Error(std::string(kInstructionSetVariable) + "=" + wanted + ": unknown instruction set; use one of " + known +
              ", or unset the variable");
}

InstructionSet selected_instruction_set() {
  static const InstructionSet selected =
      chosen_instruction_set(std::getenv(kInstructionSetVariable), widest_instruction_set());
  return selected;
}

std::vector<InstructionSet> supported_instruction_sets() {
  std::vector<InstructionSet> sets;
  for (const InstructionSet set : choice_values<InstructionSet>()) {
    if (set <= widest_instruction_set()) sets.push_back(set);
  }
  return sets;
}

}  // namespace fringeslam
