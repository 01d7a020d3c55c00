// SPDX-License-Identifier: Apache-2.0
// How much of the code the tests execute, and how many changes to it they detect.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "bench/row.h"
#include "bench/script.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

nlohmann::json result_of(const std::string& script, const std::string& arguments) {
  const std::string text = output_of("'" FRINGESLAM_SOURCE "/bench/robust/" + script + "' " + arguments);
  if (!text.starts_with("{")) throw Error(script + ": printed no result; see its message above");
  return nlohmann::json::parse(text);
}

std::vector<Row> coverage_rows(const Context&) {
  std::vector<Row> rows;
  const nlohmann::json folders = result_of("coverage.sh", "");
  for (const auto& [folder, counts] : folders.items())
    rows.push_back(
        bound_row("robust.coverage." + folder, counts.at("percent"), counts.at("lines"), "%", 90, Limit::least));
  return rows;
}

std::vector<Row> mutant_rows(const Context& context) {
  constexpr int kMutants = 200, kQuickMutants = 10;
  const int last = std::min(context.last_case, context.first_case + (context.quick ? kQuickMutants : kMutants) - 1);
  const nlohmann::json result =
      result_of("mutants.py", std::to_string(context.first_case) + " " + std::to_string(last) + " " +
                                  std::to_string(context.minutes));
  const int mutants = result.at("mutants"), detected = result.at("detected");
  return {bound_row("robust.mutants", static_cast<double>(detected) / std::max(1, mutants), mutants, "", 0.8,
                    Limit::least)};
}

}  // namespace

std::vector<Item> code_items() {
  return {{{"robust.coverage.core", "robust.coverage.sim", "robust.coverage.hw", "robust.coverage.tools"},
           "lines that the tests execute",
           coverage_rows,
           true},
          {{"robust.mutants"}, "random changes of one token in core that the tests detect", mutant_rows, true}};
}

}  // namespace fringeslam::bench
