// SPDX-License-Identifier: Apache-2.0
// Results lost when the program is killed at its system calls or when these fail.
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "bench/robust/crash_trials.h"
#include "bench/row.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> kill_rows(const Context& context) {
  std::string name = (std::filesystem::temp_directory_path() / "fringeslam-kill-XXXXXX").string();
  if (!mkdtemp(name.data())) throw Error(name + ": cannot be created");
  robust::CrashOptions options;
  // For each of kCrashTasks; the shortest has fewer calls.
  options.kills_per_task = context.quick ? 5 : 250;
  options.failures_per_task = context.quick ? 8 : 200;
  options.minutes = context.minutes;
  const robust::CrashReport report = robust::crash_trials(
      {FRINGESLAM_BENCH_PROGRAM, FRINGESLAM_INJECT_FAULT, FRINGESLAM_RECORD_STACKS}, name, options);
  std::filesystem::remove_all(name);
  if (!report.possible) throw Error("robust.kill: processes cannot be traced on this computer");
  const int trials = report.kills + report.failures;
  std::fprintf(stderr, "  %d kills and %d failed calls, %d of them reached\n", report.kills, report.failures,
               report.hit);
  return {bound_row("robust.kill", static_cast<double>(report.losses.size()), trials, "results lost", 0, Limit::most)};
}

}  // namespace

std::vector<Item> robust_items() {
  return {{{"robust.kill"}, "results lost when the program is killed or its system calls fail", kill_rows, true}};
}

}  // namespace fringeslam::bench
