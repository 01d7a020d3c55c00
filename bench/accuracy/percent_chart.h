// SPDX-License-Identifier: Apache-2.0
// A picture of a table of percentages: a group of bars for each of its lines.
#pragma once

#include <string>
#include <vector>

namespace fringeslam::bench {

struct BarGroup {
  std::string name;
  std::vector<double> percents;  // a bar each; NaN: none
};

// `names`: of each group's bars, at most three.
void write_percent_chart(const std::string& file, const std::string& title, const std::vector<std::string>& names,
                         const std::vector<BarGroup>& groups);

}  // namespace fringeslam::bench
