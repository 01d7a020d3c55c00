// SPDX-License-Identifier: Apache-2.0
// Data-parallel loops. Results do not depend on the number of threads: the body writes only to its own rows, and the
// caller adds per-row sums in row order.
#pragma once

#include <atomic>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace fringeslam {

// While an instance exists and `wanted` is true, the loops of its thread run serially in that thread. Use it in threads
// that already run concurrently, which would otherwise compete by spreading their loops over all cores.
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

// Calls body(first, end) for disjoint ranges that cover [0, rows); use it when the setup cost should be shared by many
// rows.
template <class Body>
void for_each_range(int rows, const Body& body) {
  if (SerialLoops::wanted()) return body(0, rows);
#ifdef __SANITIZE_THREAD__
  // The thread sanitizer does not see how OpenCV's threads wait for each other, because the library is not instrumented.
  char start = 0, end = 0;
  __tsan_release(&start);
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) {
    __tsan_acquire(&start);
    body(range.start, range.end);
    __tsan_release(&end);
  });
  __tsan_acquire(&end);
#else
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) { body(range.start, range.end); });
#endif
}

// Calls body(row) for each row in [0, rows).
template <class Body>
void for_each_row(int rows, const Body& body) {
  for_each_range(rows, [&](int first, int end) {
    for (int row = first; row < end; ++row) body(row);
  });
}

}  // namespace fringeslam
