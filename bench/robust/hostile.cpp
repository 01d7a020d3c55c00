// SPDX-License-Identifier: Apache-2.0
// Promises that mutated input files make the program break.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "bench/robust/flood.h"
#include "bench/row.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> hostile_rows(const Context& context) {
  constexpr int kCases = 20000, kQuickCases = 500;
  const int last = std::min(context.last_case, context.first_case + (context.quick ? kQuickCases : kCases) - 1);
  std::string name = (std::filesystem::temp_directory_path() / "fringeslam-hostile-answer-XXXXXX").string();
  if (!mkdtemp(name.data())) throw Error(name + ": cannot be created");
  const std::string answer = name + "/answer.json";
  const std::string command = std::string("'" FRINGESLAM_HOSTILE_INPUTS "' ") + std::to_string(context.first_case) +
                              " " + std::to_string(last) + " " + std::to_string(60 * context.minutes) +
                              " '" FRINGESLAM_SCENES "' > '" + answer + "'";
  if (std::system(command.c_str()) != 0) throw Error("robust.hostile: see the message above");
  const auto report = nlohmann::json::parse(std::ifstream(answer));
  std::filesystem::remove_all(name);
  std::fprintf(stderr, "  %d accepted, %d refused\n", report.at("accepted").get<int>(),
               report.at("refused").get<int>());
  return {bound_row("robust.hostile", report.at("findings"), report.at("cases"), "findings", 0, Limit::most)};
}

}  // namespace

std::vector<Item> hostile_items() {
  return {{{"robust.hostile"}, "crashes, hangs and unclear messages with mutated inputs", hostile_rows, true},
          {{"live.flood"}, "mapping with a flooded live page, relative to a calm one", flood_rows, true}};
}

}  // namespace fringeslam::bench
