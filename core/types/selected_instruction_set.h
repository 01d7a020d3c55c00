// SPDX-License-Identifier: Apache-2.0
// The instruction set for which kernels are selected (core/base/instruction_set.h): the widest one of the CPU, or the
// one that the environment variable FRINGESLAM_INSTRUCTION_SET names. Results do not depend on it; the variable exists
// to verify this.
#pragma once

#include "core/base/instruction_set.h"
#include "core/types/options.h"

namespace fringeslam {

constexpr const char* kInstructionSetVariable = "FRINGESLAM_INSTRUCTION_SET";

constexpr auto choices(InstructionSet) {
  return std::to_array<Choice<InstructionSet>>(
      {{InstructionSet::portable, "portable"}, {InstructionSet::avx2, "avx2"}, {InstructionSet::avx512, "avx512"}});
}

// Returns the instruction set named `wanted`, or the widest one if it is null or empty. Throws Error if the name is
// unknown or the set is wider than `widest`.
InstructionSet chosen_instruction_set(const char* wanted, InstructionSet widest);

// Returns the set that the environment and the CPU select, constant for the life of the process. Throws Error as
// chosen_instruction_set() does.
InstructionSet selected_instruction_set();

// Returns the instruction sets that this CPU supports, portable first.
std::vector<InstructionSet> supported_instruction_sets();

}  // namespace fringeslam
