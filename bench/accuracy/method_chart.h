// SPDX-License-Identifier: Apache-2.0
// A picture of the table of landmark methods.
#pragma once

#include <string>
#include <vector>

namespace fringeslam::bench {

struct MethodBar {
  std::string name;
  double recognised = 0, repeated = 0, right = 0;  // %
};

void write_method_chart(const std::string& file, const std::vector<MethodBar>& bars, int pairs);

}  // namespace fringeslam::bench
