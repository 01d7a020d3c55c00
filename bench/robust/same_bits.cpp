// SPDX-License-Identifier: Apache-2.0
// Trials whose output depends on the number of threads, the instruction set or the shards.
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "bench/robust/bit_trials.h"
#include "bench/row.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> same_bits_rows(const Context& context) {
  std::string name = (std::filesystem::temp_directory_path() / "fringeslam-bits-XXXXXX").string();
  if (!mkdtemp(name.data())) throw Error(name + ": cannot be created");
  robust::BitOptions options;
  options.every_pair = !context.quick;
  options.minutes = context.minutes;
  if (!context.quick) options.scene = std::filesystem::path(FRINGESLAM_SCENES) / "boxes_and_foam";
  const robust::BitReport report = robust::compare_bits(FRINGESLAM_BENCH_PROGRAM, name, options);
  std::filesystem::remove_all(name);
  std::string sets;
  for (const std::string& set : report.sets) sets += (sets.empty() ? "" : ", ") + set;
  std::fprintf(stderr, "  %s; %d files, digest %016llx\n", sets.c_str(), report.files,
               static_cast<unsigned long long>(report.digest));
  return {bound_row("robust.same_bits", static_cast<double>(report.differences.size()), report.compared,
                    "results that differ", 0, Limit::most)};
}

}  // namespace

std::vector<Item> same_bits_items() {
  return {{{"robust.same_bits"}, "threads, instruction sets and shards that change results", same_bits_rows, true}};
}

}  // namespace fringeslam::bench
