// SPDX-License-Identifier: Apache-2.0
// Suites of rows, and the comparison with a baseline.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "bench/row.h"

namespace fringeslam::bench {

// Contents of bench/accuracy/suites/NAME.yaml.
struct Suite {
  bool quick = false;
  std::vector<std::string> rows;  // ids as in --only
};

// Throws Error listing the available suites if there is no such suite.
Suite read_suite(const std::filesystem::path& folder, const std::string& name);

// True if `wanted` selects the id: "pose" selects "pose", "pose.bound", …
bool selects(const std::string& wanted, const std::string& id);

// Returns the ids that select none of the rows.
std::vector<std::string> ids_without_row(const std::vector<std::string>& ids, const std::vector<Row>& rows);

nlohmann::ordered_json to_json(const Row& row);

// Reads the rows of an earlier --json FILE. Throws Error with file:line.
std::vector<Row> read_baseline(const std::filesystem::path& file);

// True if a row is significantly worse than before: the 95 % intervals are disjoint, on the wrong side. Always false
// for a row without an interval.
bool is_worse(const Row& now, const Row& before);

}  // namespace fringeslam::bench
