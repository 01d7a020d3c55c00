// SPDX-License-Identifier: Apache-2.0
// Rows that are measured together, and whether they became worse than they were.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "bench/row.h"

namespace fringeslam::bench {

// bench/accuracy/suites/NAME.yaml.
struct Suite {
  bool quick = false;
  std::vector<std::string> rows;  // as --only has them
};

// Throws Error, naming the suites that there are.
Suite read_suite(const std::filesystem::path& folder, const std::string& name);

nlohmann::ordered_json to_json(const Row& row);

// Rows of an earlier --json FILE. Throws Error with file:line.
std::vector<Row> read_baseline(const std::filesystem::path& file);

// Whether a row is worse than it was for certain: their 95 % intervals lie apart, on the wrong side. A row of which
// only one value is known has no interval to lie apart; of such nothing is said.
bool is_worse(const Row& now, const Row& before);

}  // namespace fringeslam::bench
