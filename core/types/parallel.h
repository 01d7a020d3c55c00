// SPDX-License-Identifier: Apache-2.0
// Data-parallel loops. Results never depend on the number of threads: a body writes only to its own
// rows, and sums are kept by row and added in row order by the caller.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

namespace fringeslam {

// As long as it lives, the loops of its thread run in that thread alone. Threads that each work at something of their
// own would only get in each other's way if each spread its loops over all cores.
class SerialLoops {
 public:
  SerialLoops() { ++alive(); }
  ~SerialLoops() { --alive(); }
  SerialLoops(const SerialLoops&) = delete;
  SerialLoops& operator=(const SerialLoops&) = delete;

  static bool wanted() { return alive() > 0; }

 private:
  static int& alive() {
    thread_local int count = 0;
    return count;
  }
};

// Calls body(first, end) for parts of [0, rows) that together are all of it. For what is set up once for many rows.
template <class Body>
void for_each_range(int rows, const Body& body) {
  if (SerialLoops::wanted()) return body(0, rows);
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) { body(range.start, range.end); });
}

// Calls body(row) for every row of [0, rows).
template <class Body>
void for_each_row(int rows, const Body& body) {
  for_each_range(rows, [&](int first, int end) {
    for (int row = first; row < end; ++row) body(row);
  });
}

}  // namespace fringeslam
