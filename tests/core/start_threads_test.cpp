// SPDX-License-Identifier: Apache-2.0
#include "core/base/start_threads.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <system_error>

#include "core/base/limited_child.h"

namespace fringeslam {
namespace {

TEST(StartThreads, RunsEachFunction) {
  std::atomic<int> sum = 0;
  for (std::thread& thread : start_threads({[&] { sum += 1; }, [&] { sum += 10; }}, [] {})) thread.join();
  EXPECT_EQ(sum, 11);
}

// The memory suffices for the stacks of a few threads.
TEST(StartThreads, OneThatCannotBeStartedEndsTheOthers) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the memory of programs with sanitizers is not limited";
#endif
  const ChildAnswer answer = answer_of_child({20, 0.1, ChildReads::nothing}, [] {
    constexpr size_t kThreads = 1000;
    std::atomic<bool> stopped = false;
    std::atomic<int> started = 0, ended = 0;
    const auto wait = [&] {
      ++started;
      stopped.wait(false);
      ++ended;
    };
    const auto stop = [&] {
      stopped = true;
      stopped.notify_all();
    };
    try {
      start_threads(std::vector<std::function<void()>>(kThreads, wait), stop);
    } catch (const std::system_error&) {
      return std::string(started > 0 && ended == started ? "all ended" : "some remain");
    }
    return std::string("all started");
  });
  EXPECT_EQ(answer.bytes, "all ended");
}

}  // namespace
}  // namespace fringeslam
