// SPDX-License-Identifier: Apache-2.0
#include "core/base/bounded_queue.h"

#include <gtest/gtest.h>

#include <future>
#include <memory>
#include <thread>

namespace fringeslam {
namespace {

template <class Item>
std::vector<Item> drained(BoundedQueue<Item>& queue) {
  std::vector<Item> items;
  while (auto item = queue.pop()) items.push_back(std::move(*item));
  return items;
}

TEST(BoundedQueue, KeepLatestDropsTheOldestAndCountsThem) {
  BoundedQueue<int> queue(3, WhenFull::keep_latest);
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(queue.push(i));
  queue.close();
  EXPECT_EQ(drained(queue), (std::vector<int>{7, 8, 9}));
  EXPECT_EQ(queue.dropped(), 7);
}

TEST(BoundedQueue, KeepAllLosesNothingAndKeepsTheOrder) {
  constexpr int kItems = 10000;
  BoundedQueue<int> queue(2, WhenFull::keep_all);
  std::thread producer([&] {
    for (int i = 0; i < kItems; ++i) queue.push(i);
    queue.close();
  });
  const std::vector<int> items = drained(queue);
  producer.join();
  ASSERT_EQ(items.size(), static_cast<size_t>(kItems));
  EXPECT_TRUE(std::is_sorted(items.begin(), items.end()));
  EXPECT_EQ(queue.dropped(), 0);
}

TEST(BoundedQueue, AFullQueueMakesTheProducerWait) {
  BoundedQueue<int> queue(1, WhenFull::keep_all);
  queue.push(0);
  auto second = std::async(std::launch::async, [&] { return queue.push(1); });
  EXPECT_EQ(second.wait_for(std::chrono::milliseconds(20)), std::future_status::timeout);
  EXPECT_EQ(queue.pop(), 0);
  EXPECT_TRUE(second.get());
  EXPECT_EQ(queue.pop(), 1);
}

TEST(BoundedQueue, CancelEndsWaitingProducersAndConsumers) {
  BoundedQueue<int> full(1, WhenFull::keep_all), empty(1, WhenFull::keep_all);
  full.push(0);
  auto producer = std::async(std::launch::async, [&] { return full.push(1); });
  auto consumer = std::async(std::launch::async, [&] { return empty.pop(); });
  full.cancel();
  empty.cancel();
  EXPECT_FALSE(producer.get());
  EXPECT_FALSE(consumer.get().has_value());
  EXPECT_FALSE(full.pop().has_value()) << "cancel discards what was queued";
}

TEST(BoundedQueue, HoldsItemsThatCanOnlyBeMoved) {
  BoundedQueue<std::unique_ptr<int>> queue(1, WhenFull::keep_latest);
  queue.push(std::make_unique<int>(4));
  EXPECT_EQ(**queue.pop(), 4);
}

}  // namespace
}  // namespace fringeslam
