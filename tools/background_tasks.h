// SPDX-License-Identifier: Apache-2.0
// Runs tasks in a few threads, for work that nothing waits for, such as writing files.
#pragma once

#include <algorithm>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "core/base/bounded_queue.h"
#include "core/base/parallel.h"
#include "core/base/start_threads.h"

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
    tasks_.push(std::move(task));
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
  std::exception_ptr failure_;  // guarded by mutex_
  std::vector<std::thread> threads_;
};

}  // namespace fringeslam::tools
