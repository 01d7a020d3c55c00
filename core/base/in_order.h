// SPDX-License-Identifier: Apache-2.0
// Concurrent work whose results are used in order.
#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <future>
#include <opencv2/core/utility.hpp>
#include <utility>

#include "core/base/parallel.h"

namespace fringeslam {

// Returns the policy of std::async() for work beside the caller's: no other thread where loops run serially.
inline std::launch beside_caller() {
  return SerialLoops::wanted() || cv::getNumThreads() <= 1 ? std::launch::deferred : std::launch::async;
}

// Calls make(i) for each i in [0, count) in other threads, and take(result) in this thread, in the order of i. `most`
// limits the results in memory, finished or not. Loops inside make() run serially. Throws what make() or take() threw,
// after the calls of make() that had begun.
template <class Make, class Take>
void in_order(size_t count, size_t most, const Make& make, const Take& take) {
  const auto cores = static_cast<size_t>(std::max(1, cv::getNumThreads()));
  if (beside_caller() == std::launch::deferred || most <= 1 || count <= 1) {
    for (size_t i = 0; i < count; ++i) take(make(i));
    return;
  }
  // One more than there are cores, which are busy then while a result is taken.
  const size_t together = std::min(most, cores + 1);
  std::deque<std::future<decltype(make(size_t{0}))>> begun;
  size_t next = 0;
  const auto begin = [&] {
    begun.push_back(std::async(std::launch::async, [&make, i = next++] {
      const SerialLoops serial;
      return make(i);
    }));
  };
  while (next < std::min(count, together)) begin();
  while (!begun.empty()) {
    auto result = begun.front().get();
    begun.pop_front();
    take(std::move(result));
    if (next < count) begin();
  }
}

}  // namespace fringeslam
