// SPDX-License-Identifier: Apache-2.0
// Instruction sets, threads and shards give the same bytes: the row robust.same_bits with a few of its trials.
#include <gmock/gmock.h>

#include "bench/robust/bit_trials.h"
#include "bench/robust/child_runs.h"
#include "core/types/selected_instruction_set.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using testing::HasSubstr;

TEST(SameBits, ForEveryInstructionSetAndNumberOfThreads) {
  const test::TempFolder temp;
  robust::BitOptions options;
  options.every_pair = false;
  options.tasks = {"run"};
  const robust::BitReport report = robust::compare_bits(FRINGESLAM_PROGRAM, temp.path(), options);
  EXPECT_THAT(report.differences, testing::IsEmpty());
  EXPECT_EQ(report.sets.size(), supported_instruction_sets().size());
  EXPECT_GE(report.compared, 3);
  EXPECT_GE(report.files, 20);
}

TEST(InstructionSets, AreChosenByName) {
  for (const InstructionSet widest : choice_values<InstructionSet>()) {
    EXPECT_EQ(chosen_instruction_set(nullptr, widest), widest);
    EXPECT_EQ(chosen_instruction_set("", widest), widest);
    EXPECT_EQ(chosen_instruction_set("portable", widest), InstructionSet::portable);
  }
  EXPECT_EQ(chosen_instruction_set("avx2", InstructionSet::avx512), InstructionSet::avx2);
  EXPECT_EQ(
      test::message_of([] { chosen_instruction_set("avx512", InstructionSet::avx2); }),
      "FRINGESLAM_INSTRUCTION_SET=avx512: this processor does not support it; its widest instruction set is avx2");
  EXPECT_THAT(test::message_of([] { chosen_instruction_set("neon", InstructionSet::avx2); }),
              HasSubstr("unknown instruction set; use one of portable, avx2, avx512"));
}

TEST(InstructionSets, AWrongChoiceIsAnErrorOfTheProgram) {
  const test::TempFolder temp;
  const robust::Ended ended = robust::execute(
      temp.path(), "FRINGESLAM_INSTRUCTION_SET=sse9 " + robust::shell_line({FRINGESLAM_PROGRAM, "settings"}));
  EXPECT_EQ(ended.exit_code, 2);
  EXPECT_EQ(ended.out, "");
  EXPECT_THAT(ended.err, HasSubstr("fringeslam: FRINGESLAM_INSTRUCTION_SET=sse9: unknown instruction set"));
}

}  // namespace
}  // namespace fringeslam
