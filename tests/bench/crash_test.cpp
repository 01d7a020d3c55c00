// SPDX-License-Identifier: Apache-2.0
// A few of the kills and failed system calls of the row robust.kill.
#include <gmock/gmock.h>

#include "bench/robust/crash_trials.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

TEST(Crash, LosesNoResult) {
  const test::TempFolder temp;
  robust::CrashOptions options;
  options.kills_per_task = 6;
  options.failures_per_task = 8;
  const robust::CrashReport report = robust::crash_trials(
      {FRINGESLAM_PROGRAM, FRINGESLAM_INJECT_FAULT, FRINGESLAM_RECORD_STACKS}, temp.path(), options);
  if (!report.possible) GTEST_SKIP() << "processes cannot be traced on this computer";
  EXPECT_THAT(report.losses, testing::IsEmpty());
  EXPECT_GE(report.hit, 60) << "of " << report.kills + report.failures;
}

}  // namespace
}  // namespace fringeslam
