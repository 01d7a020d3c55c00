// SPDX-License-Identifier: Apache-2.0
// Trials' lines as values.
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
  double translation_mm = std::numeric_limits<double>::quiet_NaN();  // NaN: there was no motion to measure
  double rotation_deg = std::numeric_limits<double>::quiet_NaN();
  std::vector<std::string> values;  // of each parameter
  std::vector<double> numbers;      // the same; NaN for those that are none
};

// By trial. `lines`: merged results.
std::vector<Row> rows_of(const Study& study, const std::map<int, std::string>& lines);

}  // namespace fringeslam::studies
