// SPDX-License-Identifier: Apache-2.0
// Data-parallel loops. Results never depend on the number of threads: a body writes only to its own
// rows, and sums are kept by row and added in row order by the caller.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

namespace fringeslam {

// Calls body(row) for every row of [0, rows).
template <class Body>
void for_each_row(int rows, const Body& body) {
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) {
    for (int row = range.start; row < range.end; ++row) body(row);
  });
}

}  // namespace fringeslam
