// SPDX-License-Identifier: Apache-2.0
// Keeps the number of threads that work at the same time within the number of cores: more of them would evict each
// other's images from the caches.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>

namespace fringeslam {

class CoreShare {
 public:
  explicit CoreShare(int cores) : cores_(cores) {}

  // A core in use for as long as the turn exists. With `wait`, the constructor waits until a core is free.
  class Turn {
   public:
    explicit Turn(CoreShare& share, bool wait) : share_(share) {
      std::unique_lock lock(share_.mutex_);
      if (wait) share_.changed_.wait(lock, [&] { return share_.stopping_ || share_.at_work_ < share_.cores_; });
      share_.count(1);
    }
    ~Turn() {
      const std::lock_guard lock(share_.mutex_);
      share_.count(-1);
    }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    CoreShare& share_;
  };

  // True while all cores are in use; for SerialLoops.
  const std::atomic<bool>& none_left() const { return none_left_; }
  // Ends all waiting.
  void stop() {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }

 private:
  void count(int more) {
    at_work_ += more;
    none_left_ = at_work_ >= cores_;
    changed_.notify_all();
  }

  const int cores_;
  std::mutex mutex_;
  std::condition_variable changed_;
  int at_work_ = 0;
  bool stopping_ = false;
  std::atomic<bool> none_left_ = false;
};

}  // namespace fringeslam
