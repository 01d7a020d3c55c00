// SPDX-License-Identifier: Apache-2.0
#include "core/base/in_order.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

namespace fringeslam {
namespace {

TEST(InOrder, ResultsKeepTheirOrderAndAreLimited) {
  constexpr size_t kCount = 200, kMost = 3;
  std::atomic<size_t> alive = 0, largest = 0;
  std::vector<size_t> taken;
  in_order(
      kCount, kMost,
      [&](size_t i) {
        const size_t now = ++alive;
        for (size_t seen = largest; now > seen && !largest.compare_exchange_weak(seen, now);) {
        }
        std::this_thread::sleep_for(std::chrono::microseconds(i % 7 * 100));  // later ones may finish first
        return i;
      },
      [&](size_t i) {
        taken.push_back(i);
        --alive;
      });
  std::vector<size_t> expected(kCount);
  std::iota(expected.begin(), expected.end(), size_t{0});
  EXPECT_EQ(taken, expected);
  EXPECT_LE(largest, kMost);
}

TEST(InOrder, FailuresReachTheCaller) {
  std::vector<size_t> taken;
  const auto take = [&](size_t i) { taken.push_back(i); };
  EXPECT_THROW(in_order(
                   10, 3,
                   [](size_t i) {
                     if (i == 4) throw std::runtime_error("4");
                     return i;
                   },
                   take),
               std::runtime_error);
  EXPECT_EQ(taken, (std::vector<size_t>{0, 1, 2, 3}));
  EXPECT_THROW(in_order(
                   10, 3, [](size_t i) { return i; }, [](size_t) { throw std::runtime_error("take"); }),
               std::runtime_error);
}

TEST(InOrder, LoopsInsideRunSerially) {
  const int threads = cv::getNumThreads();
  in_order(
      4, 3, [&](size_t) { return threads == 1 || SerialLoops::wanted(); }, [](bool serial) { EXPECT_TRUE(serial); });
  EXPECT_FALSE(SerialLoops::wanted());
}

}  // namespace
}  // namespace fringeslam
