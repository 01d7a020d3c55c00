// SPDX-License-Identifier: Apache-2.0
#include "core/rig/background_rig.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>

#include "core/types/error.h"

namespace fringeslam {
namespace {

PatternSequence patterns(int width) { return {width, 1, {}}; }

// Numbers its stacks. The camera stops at `open` stacks until open() raises that number.
class Numbers : public Rig {
 public:
  explicit Numbers(int stacks, int open = 1 << 30) : stacks_(stacks), open_(open) {}
  const RigModel& model() const override { return model_; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override {
    for (int open = open_; next_ >= open; open = open_) open_.wait(open);
    if (fails_at == next_) throw Error("the camera is gone");
    if (next_ == stacks_) {
      ended = true;
      ended.notify_all();
      return std::nullopt;
    }
    FringeStack stack;
    stack.index = next_++;
    stack.timestamp_s = interval_s * stack.index;
    stack.patterns = sequence;
    return stack;
  }
  void open(int stacks) {
    open_ = stacks;
    open_.notify_all();
  }
  int fails_at = -1;
  double interval_s = 0.02;
  std::atomic<bool> ended = false;

 private:
  RigModel model_;
  int stacks_, next_ = 0;
  std::atomic<int> open_;
};

TEST(BackgroundRig, DropsTheOldestAndCountsThem) {
  Numbers camera(10);
  BackgroundRig rig(camera, patterns(1), 3, Pace::free);
  camera.ended.wait(false);
  std::vector<int> seen;
  while (const auto stack = rig.capture(patterns(1))) seen.push_back(stack->index);
  EXPECT_EQ(seen, (std::vector<int>{7, 8, 9}));
  EXPECT_EQ(rig.dropped(), 7);
  EXPECT_FALSE(rig.capture(patterns(1)).has_value()) << "the end stays the end";
}

TEST(BackgroundRig, DropsNothingForAConsumerThatKeepsUp) {
  constexpr int kStacks = 200;
  Numbers camera(kStacks, 1);
  BackgroundRig rig(camera, patterns(1), 1, Pace::free);
  for (int i = 0; i < kStacks; ++i) {
    const auto stack = rig.capture(patterns(1));
    ASSERT_TRUE(stack.has_value());
    EXPECT_EQ(stack->index, i);
    camera.open(i + 2);
  }
  EXPECT_EQ(rig.dropped(), 0);
}

TEST(BackgroundRig, DropsStacksWithOtherPatterns) {
  Numbers camera(100000, 1);
  BackgroundRig rig(camera, patterns(1), 100000, Pace::free);
  EXPECT_EQ(rig.capture(patterns(1))->patterns.width, 1);
  auto answer = std::async(std::launch::async, [&] { return rig.capture(patterns(2)); });
  // The camera may have been asked for the earlier patterns already.
  for (int stacks = 2; answer.wait_for(std::chrono::milliseconds(1)) != std::future_status::ready; ++stacks)
    camera.open(stacks);
  const auto stack = answer.get();
  const int dropped = rig.dropped();
  camera.open(1 << 30);
  ASSERT_TRUE(stack.has_value());
  EXPECT_EQ(stack->patterns.width, 2);
  EXPECT_EQ(dropped, stack->index - 1);
}

TEST(BackgroundRig, ReportsAFailureAfterTheStacksBeforeIt) {
  Numbers camera(10);
  camera.fails_at = 2;
  BackgroundRig rig(camera, patterns(1), 5, Pace::free);
  EXPECT_EQ(rig.capture(patterns(1))->index, 0);
  EXPECT_EQ(rig.capture(patterns(1))->index, 1);
  EXPECT_THROW(rig.capture(patterns(1)), Error);
}

TEST(BackgroundRig, ReplaysAtTheTimestamps) {
  Numbers camera(6);
  const auto start = std::chrono::steady_clock::now();
  BackgroundRig rig(camera, patterns(1), 6, Pace::timestamps);
  int stacks = 0;
  while (rig.capture(patterns(1))) ++stacks;
  EXPECT_EQ(stacks, 6);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(100)) << "never early";
}

// A recording with long pauses must not keep a program from ending; this one would take longer than the clock can count.
TEST(BackgroundRig, EndsWhileItWaitsForATimestamp) {
  Numbers camera(2);
  camera.interval_s = 1e12;
  std::atomic<bool> ends = false;
  BackgroundRig rig(camera, patterns(1), 2, Pace::timestamps, [&] { return ends.load(); });
  EXPECT_TRUE(rig.capture(patterns(1)).has_value());
  auto second = std::async(std::launch::async, [&] { return rig.capture(patterns(1)); });
  EXPECT_EQ(second.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  ends = true;
  EXPECT_FALSE(second.get().has_value());
}

TEST(BackgroundRig, EndsWithoutAConsumer) {
  Numbers camera(1000000);
  { BackgroundRig rig(camera, patterns(1), 2, Pace::timestamps); }
  SUCCEED();
}

}  // namespace
}  // namespace fringeslam
