// SPDX-License-Identifier: Apache-2.0
// Data-parallel loops. Results never depend on the number of threads: a body writes only to its own
// rows, and sums are kept by row and added in row order by the caller.
#pragma once

#include <atomic>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

namespace fringeslam {

// As long as it lives, and `wanted` is true, the loops of its thread run in that thread alone. Threads that each work
// at something of their own would only get in each other's way if each spread its loops over all cores.
class SerialLoops {
 public:
  explicit SerialLoops(const std::atomic<bool>& wanted = always()) : before_(of_thread()) { of_thread() = &wanted; }
  ~SerialLoops() { of_thread() = before_; }
  SerialLoops(const SerialLoops&) = delete;
  SerialLoops& operator=(const SerialLoops&) = delete;

  static bool wanted() { return of_thread() != nullptr && of_thread()->load(std::memory_order_relaxed); }

 private:
  static const std::atomic<bool>& always() {
    static const std::atomic<bool> yes = true;
    return yes;
  }
  static const std::atomic<bool>*& of_thread() {
    thread_local const std::atomic<bool>* wanted = nullptr;
    return wanted;
  }
  const std::atomic<bool>* before_;
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
