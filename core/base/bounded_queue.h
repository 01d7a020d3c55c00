// SPDX-License-Identifier: Apache-2.0
// A queue between threads that holds at most a given number of items. A full queue either makes the producer wait, so
// that all items are kept, or drops its oldest item, so that the latest are kept.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

namespace fringeslam {

enum class WhenFull { keep_all, keep_latest };

template <class Item>
class BoundedQueue {
 public:
  BoundedQueue(size_t capacity, WhenFull when_full) : capacity_(std::max<size_t>(1, capacity)), when_full_(when_full) {}

  // Returns false, without taking the item, if the queue is closed. With keep_all, waits for room.
  bool push(Item item) {
    {
      std::unique_lock lock(mutex_);
      if (when_full_ == WhenFull::keep_all) changed_.wait(lock, [&] { return closed_ || items_.size() < capacity_; });
      if (closed_) return false;
      items_.push_back(std::move(item));
      if (items_.size() > capacity_) {
        items_.pop_front();
        ++dropped_;
      }
    }
    changed_.notify_all();
    return true;
  }

  // Returns the oldest item and waits for one; empty if the queue is closed and all items were taken.
  std::optional<Item> pop() {
    std::optional<Item> item;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closed_ || !items_.empty(); });
      if (items_.empty()) return item;
      item = std::move(items_.front());
      items_.pop_front();
    }
    changed_.notify_all();
    return item;
  }

  // Items pushed later are refused; those in the queue can still be taken.
  void close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    changed_.notify_all();
  }
  // Closes the queue and discards its items.
  void cancel() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
      items_.clear();
    }
    changed_.notify_all();
  }

  int dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  const size_t capacity_;
  const WhenFull when_full_;
  mutable std::mutex mutex_;  // guards all members below
  std::condition_variable changed_;
  std::deque<Item> items_;
  int dropped_ = 0;
  bool closed_ = false;
};

}  // namespace fringeslam
