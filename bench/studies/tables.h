// SPDX-License-Identifier: Apache-2.0
// Merged results in formats for other programs.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "bench/studies/study.h"

namespace fringeslam::studies {

// Writes results.jsonl, results.csv and results.sqlite (table `trials`, with a column for each parameter and metric),
// each atomically. The same lines give the same bytes.
void write_tables(const std::filesystem::path& folder, const Study& study, const std::map<int, std::string>& lines);

}  // namespace fringeslam::studies
