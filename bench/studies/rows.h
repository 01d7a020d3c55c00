// SPDX-License-Identifier: Apache-2.0
// Result lines of trials as values.
#pragma once

#include <limits>
#include <map>
#include <string>
#include <vector>

#include "bench/studies/study.h"

namespace fringeslam::studies {

struct Row {
  int trial = 0;
  bool success = false;
  std::string outcome, cause, message;
  double translation_mm = std::numeric_limits<double>::quiet_NaN();  // NaN: no motion to measure
  double rotation_deg = std::numeric_limits<double>::quiet_NaN();
  std::vector<std::string> values;  // by parameter
  std::vector<double> numbers;      // the same as numbers; NaN for those that are not
};

// Parses merged result lines, in order of the trials' numbers.
std::vector<Row> rows_of(const Study& study, const std::map<int, std::string>& lines);

}  // namespace fringeslam::studies
