// SPDX-License-Identifier: Apache-2.0
// Mapping while the live page is flooded with requests.
#pragma once

#include <vector>

#include "bench/row.h"

namespace fringeslam::bench {

std::vector<Row> flood_rows(const Context& context);

}  // namespace fringeslam::bench
