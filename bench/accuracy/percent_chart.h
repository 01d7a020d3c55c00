// SPDX-License-Identifier: Apache-2.0
// Bar chart of a table of percentages: one group of bars per table row.
#pragma once

#include <string>
#include <vector>

namespace fringeslam::bench {

struct BarGroup {
  std::string name;
  std::vector<double> percents;  // one bar each; NaN: none
};

// `names`: labels of the bars in each group, at most three.
void write_percent_chart(const std::string& file, const std::string& title, const std::vector<std::string>& names,
                         const std::vector<BarGroup>& groups);

}  // namespace fringeslam::bench
