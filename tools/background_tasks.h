// SPDX-License-Identifier: Apache-2.0
// Runs tasks in a few threads, for work that nothing waits for, such as writing files.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "core/base/bounded_queue.h"
#include "core/base/parallel.h"
#include "core/base/start_threads.h"
#include "core/types/error.h"

namespace fringeslam::tools {

class BackgroundTasks {
 public:
  explicit BackgroundTasks(int threads) : tasks_(static_cast<size_t>(2 * threads), WhenFull::keep_all) {
    threads_ =
        start_threads(std::vector<std::function<void()>>(static_cast<size_t>(std::max(1, threads)), [this] { work(); }),
                      [this] { tasks_.close(); });
  }
  ~BackgroundTasks() { join(); }
  BackgroundTasks(const BackgroundTasks&) = delete;
  BackgroundTasks& operator=(const BackgroundTasks&) = delete;

  // Runs `task` later; waits if too many are waiting. Throws what an earlier task threw.
  void add(std::function<void()> task) {
    rethrow();
    {
      const std::lock_guard lock(mutex_);
      ++unfinished_;
    }
    if (tasks_.push(std::move(task))) return;
    const std::lock_guard lock(mutex_);
    --unfinished_;
    throw Error("internal error: a task was added after the last one");
  }
  // Waits until the tasks that were added so far have ended.
  void wait() {
    std::unique_lock lock(mutex_);
    ended_.wait(lock, [&] { return unfinished_ == 0; });
  }
  // Waits for all tasks. Throws what one of them threw.
  void finish() {
    join();
    rethrow();
  }

 private:
  void work() {
    const SerialLoops serial;  // there are other threads
    while (const auto task = tasks_.pop()) {
      try {
        (*task)();
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = std::current_exception();
      }
      const std::lock_guard lock(mutex_);
      if (--unfinished_ == 0) ended_.notify_all();
    }
  }
  void join() {
    tasks_.close();
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  void rethrow() {
    const std::lock_guard lock(mutex_);
    if (failure_) std::rethrow_exception(failure_);
  }

  BoundedQueue<std::function<void()>> tasks_;
  std::mutex mutex_;
  std::condition_variable ended_;
  int unfinished_ = 0;          // guarded by mutex_
  std::exception_ptr failure_;  // guarded by mutex_
  std::vector<std::thread> threads_;
};

}  // namespace fringeslam::tools
